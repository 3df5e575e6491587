"""Handles of the running system on which faults act."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import can
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter

from harness.belief_watch import BeliefWatch
from harness.relay import Relay
from harness.reports import Reports
from tactile_localizer.demo.processes import NodeProcess
from tactile_localizer.demo.watcher import Watcher
from tactile_localizer.errors import LiveError
from tactile_localizer.srv import LoadScan

_LOADING_S = 60.0


@dataclass(frozen=True)
class System:
    """Handles of the running system.

    Parameters
    ----------
    nodes : processes by name
    reports : reports of the nodes
    watcher : calls their services
    relay : relay between the sensors and the filter
    bus : a second connection to the load cells' bus
    seeds : publisher of initial poses
    belief : comparison of posteriors with the truth
    scans : names of the scan files in the filter's directory: the right one, another one, a damaged one
    """

    nodes: Mapping[str, NodeProcess]
    reports: Reports
    watcher: Watcher
    relay: Relay
    bus: can.BusABC
    seeds: Any
    belief: BeliefWatch
    scans: tuple[str, str, str]

    def set(self, node: str, name: str, value: Any) -> str:
        """Set a parameter; returns the reason of a refusal, or an empty string."""
        if value == []:
            value = Parameter(name, Parameter.Type.STRING_ARRAY, [])
        else:
            value = Parameter(name, value=value)
        request = SetParameters.Request(parameters=[value.to_parameter_msg()])
        result = self.watcher.call(SetParameters, f"{node}/set_parameters", request).results[0]
        return "" if result.successful else str(result.reason)

    def change(self, node: str, *transitions: int) -> None:
        """Trigger lifecycle transitions of a node."""
        for transition in transitions:
            request = ChangeState.Request(transition=Transition(id=transition))
            if not self.watcher.call(ChangeState, f"{node}/change_state", request, _LOADING_S).success:
                raise LiveError(f"{node}: expected transition {transition}, it was refused")

    def load(self, name: str) -> str:
        """Let the filter load a scan; returns the reason of a refusal, or an empty string."""
        request = LoadScan.Request(path=name)
        answer = self.watcher.call(LoadScan, "filter/load_scan", request, timeout_s=_LOADING_S)
        return "" if answer.success else str(answer.message)
