"""Diagnostics of the driver node: the CAN bus, and each phalanx."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus

from tactile_localizer.io.can.driver import LoadCellDriver
from tactile_localizer.io.can.error_frames import ERROR_KINDS
from tactile_localizer.io.can.protocol import FrameKind
from tactile_localizer.io.can.reader import OPEN
from tactile_localizer.ros.diagnostics.status import DiagnosticsPublisher, Increments

_MIN_JUMPS = 10
_JUMPS_FRACTION = 0.2
"""Fraction of samples before which the counter jumps, since the last status, that is reported."""

_SUSPECT = (FrameKind.ERROR, FrameKind.WRONG_LENGTH, FrameKind.OUT_OF_ORDER, FrameKind.DUPLICATE)


class DriverDiagnostics:
    """Makes the statuses of a driver; rates and losses refer to the time since the previous call.

    A silent bus is OK, because the hand can be switched off. A phalanx is not OK if it stopped sending, or
    never sent although others do.

    Parameters
    ----------
    driver : driver to describe
    publisher : publisher of the statuses
    bus : name of the bus
    stale_timeout_s : time without frames after which a phalanx is stale, s
    strain_publishers : returns the number of publishers of the strain topic, including this driver
    """

    def __init__(
        self,
        driver: LoadCellDriver,
        publisher: DiagnosticsPublisher,
        bus: str,
        stale_timeout_s: float,
        strain_publishers: Callable[[], int] = lambda: 1,
    ) -> None:
        self._driver = driver
        self._publisher = publisher
        self._bus = bus
        self._stale_timeout_s = stale_timeout_s
        self._strain_publishers = strain_publishers
        self._new_on_bus = Increments()
        self._new_of_phalanx = [Increments() for _ in driver.protocol.phalanges]
        self._previous_s = time.monotonic()

    def statuses(self) -> list[DiagnosticStatus]:
        """Status of the bus, followed by one status per phalanx."""
        now_s = time.monotonic()
        elapsed_s, self._previous_s = max(now_s - self._previous_s, 1e-3), now_s
        new = [
            increments.since(asdict(counts))
            for increments, counts in zip(self._new_of_phalanx, self._driver.counts.phalanges, strict=True)
        ]
        names = self._driver.protocol.phalanges
        missing = [name for name, own in zip(names, new, strict=True) if own["missing"]]
        phalanges = [self._phalanx_status(index, own, elapsed_s) for index, own in enumerate(new)]
        return [self._bus_status(missing, elapsed_s), *phalanges]

    def _bus_status(self, missing: Sequence[str], elapsed_s: float) -> DiagnosticStatus:
        status, counts = self._driver.status, self._driver.counts
        frames = dict(zip(FrameKind, counts.frames, strict=True))
        errors = {kind: status.errors[kind] for kind in ERROR_KINDS}
        new = self._new_on_bus.since(
            {**frames, **errors, "cycles": counts.cycles, "drops": status.queue_drops}
        )
        received = sum(new[kind] for kind in frames)
        discarded = ", ".join(f"{new[kind]} {_words(kind)}" for kind in _SUSPECT if new[kind])
        bus_errors = ", ".join(f"{new[kind]} {kind}" for kind in errors if new[kind])
        publishers = self._strain_publishers()
        level, message = DiagnosticStatus.OK, "open" if received else "open, idle"
        if status.state != OPEN:
            level, message = DiagnosticStatus.ERROR, f"{status.state}: {status.error}"
        elif publishers > 1:
            level = DiagnosticStatus.ERROR
            message = f"expected one publisher of strain, found {publishers}"
        elif new["drops"]:
            level, message = DiagnosticStatus.WARN, f"{new['drops']} frames dropped, receive queue full"
        elif discarded:
            level = DiagnosticStatus.WARN
            message = f"discarded frames: {discarded}" + (f"; bus errors: {bus_errors}" if bus_errors else "")
        skew_ns, counts.skew_ns = counts.skew_ns, 0  # the largest since this status
        values = {
            "bus": self._bus,
            "state": status.state,
            "last_error": status.error,
            "reconnects": status.reconnects,
            "frames_per_s": f"{received / elapsed_s:.1f}",
            **{f"frames_{kind.name.lower()}": count for kind, count in frames.items()},
            "unreadable": status.unreadable,
            **{f"errors_{kind.replace(' ', '_')}": count for kind, count in errors.items()},
            "strain_publishers": publishers,
            "cycles": counts.cycles,
            "cycles_incomplete": counts.incomplete,
            "cycles_per_s": f"{new['cycles'] / elapsed_s:.1f}",
            "period_ms": f"{self._driver.period_ns * 1e-6:.2f}",
            "max_skew_ms": f"{skew_ns * 1e-6:.2f}",
            "missing_phalanges": " ".join(missing),
            "queue_bytes": status.queue_used,
            "queue_limit_bytes": status.queue_limit,
            "queue_drops": status.queue_drops,
        }
        return self._publisher.status("CAN bus", level, message, values)

    def _phalanx_status(self, index: int, new: Mapping[str, int], elapsed_s: float) -> DiagnosticStatus:
        protocol, latest = self._driver.protocol, self._driver.latest
        saturated: Sequence[int] = ()
        if latest is not None:
            own = protocol.saturated(latest.strain)[protocol.channels.slices[index]]
            saturated = (np.flatnonzero(own) + 1).tolist()
        counts = asdict(self._driver.counts.phalanges[index])
        last_ns = counts.pop("last_ns")
        age_s = max(0.0, time.time() - last_ns * 1e-9) if last_ns else None
        values = {
            "rate_hz": f"{new['samples'] / elapsed_s:.1f}",
            "age_s": "" if age_s is None else f"{age_s:.3f}",
            **counts,
            "saturated_gauges": " ".join(map(str, saturated)),
        }
        level, message = self._level(new, age_s)
        return self._publisher.status(protocol.phalanges[index], level, message, values)

    def _level(self, new: Mapping[str, int], age_s: float | None) -> tuple[bytes, str]:
        """Level and message of a phalanx: the most severe problem since the previous status."""
        if age_s is None and self._driver.counts.cycles:
            return DiagnosticStatus.ERROR, "silent: no frames received, while other phalanges send"
        if age_s is None:
            return DiagnosticStatus.OK, "idle"
        if age_s > self._stale_timeout_s:
            return DiagnosticStatus.ERROR, f"stale: no frames for {age_s:.1f} s"
        if new["faults"]:
            return DiagnosticStatus.ERROR, "fault reported by the load cell"
        received = new["samples"] + new["missing"]
        if new["saturated"]:
            text = "saturated"
        elif new["restarts"]:
            text = "the counter restarted: the load cell restarted, or another one has its identifiers"
        elif new["jumps"] > max(_MIN_JUMPS, _JUMPS_FRACTION * received):
            text = f"the counter jumped {new['jumps']} times: losses, or two load cells with its identifiers"
        elif new["drops"]:
            text = f"{new['drops']} frames lost"
        elif new["missing"]:
            text = f"missing in {new['missing']} of {received} cycles"
        else:
            return DiagnosticStatus.OK, "OK"
        return DiagnosticStatus.WARN, text


def _words(kind: FrameKind) -> str:
    return kind.name.lower().replace("_", " ")
