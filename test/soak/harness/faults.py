"""The injected faults and where each must be reported: the table of docs/faults.md as a program."""

from __future__ import annotations

import signal
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import can
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from lifecycle_msgs.msg import Transition
from std_srvs.srv import Empty, Trigger

from harness import spoiling
from harness.relay import leave_alone
from harness.system import System
from tactile_localizer.msg import StrainVectors

CAN_BUS, INDEX, MIDDLE = "driver: CAN bus", "driver: index", "driver: middle"
INPUTS, BELIEF, SCAN = "filter: inputs", "filter: belief", "mapping: scan"
STATUSES = (CAN_BUS, INDEX, MIDDLE, INPUTS, BELIEF, SCAN)
"""Statuses that the nodes publish once a second."""

_BUS_OFF = 0x40
_BURST = 2000
_JUMP_NS = 10_000_000_000
_SILENCE_S = 2.0


Act = Callable[[System], Any]
Shows = Callable[[System], bool]


def _nothing(system: System) -> None:
    """Do nothing: the fault ends by itself."""


class Acts(NamedTuple):
    """Begin and end of a fault."""

    begin: Act
    end: Act = _nothing


@dataclass(frozen=True)
class Fault:
    """A fault to inject.

    Parameters
    ----------
    name : in reports and on the command line
    acts : its begin and end
    shows : whether the system has reported it since it began
    within_s : time limit for the report, s
    misleads : whether false convergence is excused while it lasts
    starves : whether the filter lacks inputs while it lasts, so that no new position may be published
    """

    name: str
    acts: Acts
    shows: Shows
    within_s: float = 4.0
    misleads: bool = False
    starves: bool = False


def _parameter(name: str, bad: Any, good: Any) -> Acts:
    """A fault of the simulated load cells."""
    return Acts(
        lambda system: system.set("simulator", name, bad), lambda system: system.set("simulator", name, good)
    )


def _strain(spoil: Callable[[StrainVectors], None]) -> Acts:
    return Acts(
        lambda system: setattr(system.relay, "spoil_strain", spoil),
        lambda system: setattr(system.relay, "spoil_strain", leave_alone),
    )


def _pose(spoil: Callable[[PoseStamped], None]) -> Acts:
    return Acts(
        lambda system: setattr(system.relay, "spoil_pose", spoil),
        lambda system: setattr(system.relay, "spoil_pose", leave_alone),
    )


def _stopped(*topics: str) -> Acts:
    return Acts(
        lambda system: setattr(system.relay, "stopped", frozenset(topics)),
        lambda system: setattr(system.relay, "stopped", frozenset()),
    )


def _frozen(node: str) -> Acts:
    """A process that is suspended."""
    return Acts(
        lambda system: system.nodes[node].signal(signal.SIGSTOP),
        lambda system: system.nodes[node].signal(signal.SIGCONT),
    )


def _cycled(node: str) -> Acts:
    """A node that a lifecycle manager shuts down and restarts."""
    down = Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP
    up = Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE
    return Acts(lambda system: system.change(node, *down), lambda system: system.change(node, *up))


def _asked(kind: Any, service: str) -> Acts:
    return Acts(lambda system: system.watcher.call(kind, service))


def _clock(by_ns: int) -> Acts:
    return Acts(lambda system: setattr(system.relay, "clock_ns", system.relay.clock_ns + by_ns))


def _send_bus_off(system: System) -> None:
    system.bus.send(can.Message(arbitration_id=_BUS_OFF, is_error_frame=True, data=bytes(8)))


def _flood(system: System) -> None:
    for number in range(_BURST):
        data = number.to_bytes(8, "little")
        system.bus.send(can.Message(arbitration_id=0x7FE, is_extended_id=False, data=data))


def _seed(x: float, y: float) -> Acts:
    def publish(system: System) -> None:
        message = PoseWithCovarianceStamped()
        message.header.frame_id = "material"
        message.pose.pose.position.x, message.pose.pose.position.y = x, y
        message.pose.pose.orientation.w = 1.0
        message.pose.covariance[0] = message.pose.covariance[7] = 1e-6
        system.seeds.publish(message)

    return Acts(publish)


def _reports(name: str, *texts: str) -> Shows:
    return lambda system: system.reports.diagnosed(name, *texts)


def _logs(text: str) -> Shows:
    return lambda system: system.reports.logged(text)


def _gains(name: str, key: str, count: int = 1) -> Shows:
    return lambda system: system.reports.gained(name, key) >= count


def _falls_silent(name: str) -> Shows:
    return lambda system: system.reports.silent_s(name) > _SILENCE_S


def _maps(system: System) -> bool:
    return system.reports.newest[BELIEF].values.get("scan_file", "").endswith(system.scans[1])


def _silence(name: str, acts: Acts, message: str) -> Fault:
    """A fault that deprives the filter of inputs: it reports that, and publishes no new position."""
    return Fault(name, acts, _reports(INPUTS, message), starves=True)


_UNLIKE_THE_MAP = "outside the range of the scan", "unknown material", "lost"


def _wrong_strain(name: str, acts: Acts, *messages: str) -> Fault:
    """A phalanx that sends plausible but wrong strain, which is detected after some travel."""
    return Fault(name, acts, _reports(BELIEF, *messages), within_s=15.0, misleads=True)


FAULTS = (
    Fault("frames lost", _parameter("fault.drop", 0.1, 0.0), _reports(MIDDLE, "frames lost")),
    Fault("garbage frames", _parameter("fault.garbage", 0.1, 0.0), _reports(CAN_BUS, "discarded")),
    Fault("foreign frames, a burst", Acts(_flood), _gains(CAN_BUS, "frames_unknown_id", _BURST // 2)),
    Fault("load cell silent", _parameter("fault.silent", ["middle"], []), _reports(MIDDLE, "stale")),
    Fault("load cell fault", _parameter("fault.faulty", ["index"], []), _reports(INDEX, "fault reported")),
    Fault("bus off", Acts(_send_bus_off), _gains(CAN_BUS, "reconnects")),
    Fault("bus closed and opened", _asked(Trigger, "driver/reconnect"), _gains(CAN_BUS, "reconnects")),
    _silence("strain stops", _stopped("strain"), "no strain"),
    _silence("poses stop", _stopped("palm_pose"), "no palm_pose"),
    _silence("strain and poses stop", _stopped("strain", "palm_pose"), "no strain and no palm_pose"),
    Fault("clock set back", _clock(-_JUMP_NS), _gains(INPUTS, "backward_jumps")),
    Fault("clock set forward", _clock(_JUMP_NS), _gains(INPUTS, "forward_jumps")),
    Fault("poses out of order", _pose(spoiling.unordered), _reports(INPUTS, "late messages")),
    Fault("poses not finite", _pose(spoiling.nowhere), _gains(INPUTS, "invalid_palm_pose")),
    Fault("poses of another frame", _pose(spoiling.foreign_frame), _gains(INPUTS, "invalid_palm_pose")),
    Fault("strain not finite", _strain(spoiling.not_finite), _reports(INPUTS, "not finite")),
    Fault("strain of other phalanges", _strain(spoiling.foreign_phalanges), _gains(INPUTS, "invalid_strain")),
    _wrong_strain(
        "phalanx stuck",
        Acts(lambda system: _strain(spoiling.stuck()).begin(system), _strain(leave_alone).end),
        "stuck",
    ),
    _wrong_strain("phalanx swapped", _strain(spoiling.swapped), *_UNLIKE_THE_MAP),
    _wrong_strain("phalanx scaled", _strain(spoiling.scaled), *_UNLIKE_THE_MAP),
    Fault("wrong seed", _seed(0.045, 0.005), _logs("belief seeded"), misleads=True),
    Fault("seed out of bounds", _seed(0.4, 0.005), _gains(INPUTS, "invalid_initial_pose")),
    Fault("belief reset", _asked(Empty, "filter/reinitialize_global_localization"), _logs("belief reset")),
    Fault(
        "wrong map",
        Acts(lambda system: system.load(system.scans[1]), lambda system: system.load(system.scans[0])),
        _maps,
        misleads=True,
    ),
    Fault("damaged map", Acts(lambda system: system.load(system.scans[2])), _logs("expected a scan file")),
    Fault(
        "map outside scan_directory", Acts(lambda system: system.load("../log")), _logs("expected a path in")
    ),
    _silence("simulator frozen", _frozen("simulator"), "no strain and no palm_pose"),
    _silence("driver frozen", _frozen("driver"), "no strain"),
    Fault("filter frozen", _frozen("filter"), _falls_silent(INPUTS)),
    Fault("mapping frozen", _frozen("mapping"), _falls_silent(SCAN)),
    _silence("simulator down and up", _cycled("simulator"), "no strain and no palm_pose"),
    _silence("driver down and up", _cycled("driver"), "no strain"),
    Fault("filter down and up", _cycled("filter"), _falls_silent(INPUTS)),
    Fault("mapping down and up", _cycled("mapping"), _falls_silent(SCAN)),
)
