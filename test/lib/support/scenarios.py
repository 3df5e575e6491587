"""Scenarios of several nodes, started by launch files, with checks of their outputs."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from geometry_msgs.msg import PoseStamped, WrenchStamped
from support.hand import SlidingHand
from support.probe import Probe
from support.processes import node_command
from support.sweeps import unseen_sweep

from tactile_localizer.msg import Posterior, ScanStatus, StrainVectors
from tactile_localizer.resources import resource_path

_SIMULATED = yaml.safe_load(resource_path("config/simulator.yaml").read_text())["/**/tactile_simulator"][
    "ros__parameters"
]
"""Parameters of the simulated hand."""

_SPEED = 2.0
"""Simulated seconds per second of a hand that shares the machine with another one."""


@dataclass(frozen=True)
class Started:
    """Nodes in one namespace.

    Parameters
    ----------
    launch_file : launch file of the nodes; empty for nodes that substitute hardware
    nodes : names of the nodes, without ``tactile_``
    arguments : launch arguments, without the parameter file
    parameters : contents of the parameter file: parameters by node
    """

    launch_file: str
    nodes: Sequence[str]
    arguments: Mapping[str, Any] = field(default_factory=dict)
    parameters: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def launch_arguments(self, folder: Path) -> list[tuple[str, str]]:
        """The arguments as pairs of name and text; the parameter file is written into a folder."""
        arguments = {**self.arguments, "params_file": self._params_file(folder)}
        return [(name, str(value)) for name, value in arguments.items()]

    def commands(self, folder: Path) -> list[list[str]]:
        """The command lines of nodes that substitute hardware."""
        file = self._params_file(folder)
        return [node_command(f"{node}_node", parameter_files=[file]) for node in self.nodes]

    def _params_file(self, folder: Path) -> Path:
        file = folder / f"{self.arguments.get('namespace', 'hand')}{len(self.nodes)}.yaml"
        content = {
            f"/**/tactile_{node}": {"ros__parameters": dict(own)} for node, own in self.parameters.items()
        }
        file.write_text(
            json.dumps(content) if content else "", encoding="utf-8"
        )  # JSON is YAML without aliases
        return file


@dataclass(frozen=True)
class Place:
    """Files and buses of a scenario: a folder, a scan of the bump in it, two simulated buses."""

    folder: Path
    scan_file: Path
    buses: Sequence[Mapping[str, Any]]


@dataclass(frozen=True)
class Scenario:
    """Nodes to start and a check of their outputs.

    Parameters
    ----------
    name : test id
    started : returns the nodes to start
    check : receives their outputs through a probe and fails if they are wrong
    """

    name: str
    started: Callable[[Place], Sequence[Started]]
    check: Callable[[Probe, Place], None]


def _hardware(place: Place) -> Started:
    """Simulated load cells and arm."""
    return Started("", ("simulator",), parameters={"simulator": _SIMULATED | place.buses[0]})


def _check_strain_and_poses(probe: Probe, place: Place, namespace: str = "") -> list[Any]:
    strains = probe.listen(StrainVectors, f"{namespace}strain", probe.best_effort)
    poses = probe.listen(PoseStamped, f"{namespace}palm_pose")
    probe.until(lambda: len(strains) > 50 and len(poses) > 20, "strain and poses")
    assert list(strains[-1].phalanges) == ["index", "middle"]
    # A busy machine holds up frames; what comes too late for its cycle is missing.
    assert any(np.isfinite(message.strain).all() for message in strains)
    return strains


def _scanning(place: Place) -> Sequence[Started]:
    files = {"scan_file": place.folder / "new_scan", "scene_file": resource_path("config/scenes/bump.yaml")}
    return [
        _hardware(place),
        Started("scan.launch.py", ("driver", "mapping"), files, {"driver": place.buses[0]}),
    ]


def _check_a_recorded_sweep(probe: Probe, place: Place) -> None:
    statuses = probe.listen(ScanStatus, "tactile_mapping/status")
    _check_strain_and_poses(probe, place)
    _call(probe, "tactile_simulator/prepare")
    _call(probe, "tactile_mapping/start_sweep")
    _call(probe, "tactile_simulator/sweep")
    probe.until(lambda: statuses and statuses[-1].samples > 100, "pairs in the scan")
    _call(probe, "tactile_mapping/end_sweep")
    assert statuses[-1].scan_file == str(place.folder / "new_scan")


def _localizing(place: Place) -> Sequence[Started]:
    arguments, parameters = {"scan_file": place.scan_file}, {"driver": place.buses[0]}
    return [_hardware(place), Started("bringup.launch.py", ("driver", "filter"), arguments, parameters)]


def _check_posteriors(probe: Probe, place: Place, namespace: str = "") -> None:
    posteriors = probe.listen(Posterior, f"{namespace}tactile_filter/posterior", 1000)
    probe.until(lambda: posteriors and not posteriors[-1].stale, "an estimate")
    _call(probe, f"{namespace}tactile_simulator/prepare")
    _call(probe, f"{namespace}tactile_simulator/sweep")
    probe.until(
        lambda: posteriors[-1].travel > 0.02 and not posteriors[-1].stale,
        "posteriors that move with the hand",
    )


def _two_hands(place: Place) -> Sequence[Started]:
    return [
        Started(
            "simulate.launch.py",
            ("simulator", "driver", "filter"),
            {"namespace": hand, "mode": "localize", "scan_file": place.scan_file},
            {"simulator": _SIMULATED | {"speed": _SPEED, **bus}, "driver": bus},
        )
        for hand, bus in zip(("left", "right"), place.buses, strict=True)
    ]


def _check_two_hands(probe: Probe, place: Place) -> None:
    _check_posteriors(probe, place, "left/")
    strains = {hand: _check_strain_and_poses(probe, place, f"{hand}/") for hand in ("left", "right")}
    left, right = (
        np.nanmean([message.strain for message in strains[hand][-50:]], axis=0) for hand in ("left", "right")
    )
    assert np.abs(left - right).max() > 0.01, "only one hand holds the material"
    _check_posteriors(probe, place, "right/")


def _remapped(place: Place) -> Sequence[Started]:
    arguments = {"scan_file": place.scan_file, "namespace": "hand", "pose_topic": "arm/tool_pose"}
    return [Started("localize.launch.py", ("filter",), arguments)]


def _check_remapped_topics(probe: Probe, place: Place) -> None:
    posteriors = probe.listen(Posterior, "hand/tactile_filter/posterior", 1000)
    hand = SlidingHand(probe, unseen_sweep(), topics=("hand/strain", "hand/arm/tool_pose"))
    probe.until(lambda: probe.node.count_publishers("hand/tactile_filter/posterior"), "the filter")
    probe.until(lambda: hand.slide(1) or posteriors, "the first posterior")
    hand.slide(40)
    probe.until(lambda: posteriors[-1].travel > 0.008, "posteriors that move with the arm")


def _managed(place: Place) -> Sequence[Started]:
    parameters = {"driver": {"autostart": False, **place.buses[0]}, "filter": {"autostart": False}}
    arguments = {"scan_file": place.scan_file}
    return [_hardware(place), Started("bringup.launch.py", ("driver", "filter"), arguments, parameters)]


def _check_posteriors_after_activation(probe: Probe, place: Place) -> None:
    posteriors = probe.listen(Posterior, "tactile_filter/posterior", 1000)
    for node in ("driver", "filter"):
        for transition in ("configure", "activate"):
            assert not posteriors
            assert probe.change(f"tactile_{node}", transition)
    probe.until(lambda: posteriors and not posteriors[-1].stale, "the first posterior")


def _adapted(place: Place) -> Sequence[Started]:
    file = place.folder / "wrench.yaml"
    file.write_text("phalanges: {index: {topic: /fingertip, type: geometry_msgs/msg/WrenchStamped}}")
    parameters = {"adapter": {"adapter_file": str(file)}}
    return [Started("sensor.launch.py", ("adapter",), {"sensor": "adapter"}, parameters)]


def _check_strain_of_an_adapter(probe: Probe, place: Place) -> None:
    strains = probe.listen(StrainVectors, "strain", probe.best_effort)
    wrenches = probe.publisher(WrenchStamped, "fingertip")
    probe.until(lambda: wrenches.publish(WrenchStamped()) or strains, "strain of the fingertip")
    assert list(strains[-1].channels) == [6]


SCENARIOS = (
    Scenario("scan", _scanning, _check_a_recorded_sweep),
    Scenario("localize", _localizing, _check_posteriors),
    Scenario("two hands", _two_hands, _check_two_hands),
    Scenario("remapped topics", _remapped, _check_remapped_topics),
    Scenario("lifecycle manager", _managed, _check_posteriors_after_activation),
    Scenario("another sensor", _adapted, _check_strain_of_an_adapter),
)


def _call(probe: Probe, service: str) -> None:
    answer = probe.trigger(service)
    assert answer.success, f"{service}: {answer.message}"
