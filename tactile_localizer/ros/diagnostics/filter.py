"""Diagnostics of the filter: state and cost of the belief, and of the inputs."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from tactile_localizer.core.decision.convergence import State
from tactile_localizer.core.geometry.pose_buffer import NANOSECONDS
from tactile_localizer.core.geometry.synchronization import Pairing
from tactile_localizer.ros.localization.online_localizer import OnlineLocalizer


@dataclass
class Inputs:
    """State of the inputs.

    Parameters
    ----------
    unread : messages that could not be used at all, by topic
    lost : strain vectors that were sent and never arrived
    silent : topics without a message for ``stale_timeout_s``
    stale : why the position is stale; empty when it is not
    """

    unread: dict[str, int]
    lost: int = 0
    silent: Sequence[str] = ()
    stale: str = ""


class FilterDiagnostics:
    """Makes the diagnostics of a filter node; what was lost since the last call is a warning.

    Parameters
    ----------
    name : of the node, before each status's own name
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._lost: dict[str, int] = {}

    def statuses(self, tracker: OnlineLocalizer, scan_file: str, inputs: Inputs) -> list[Any]:
        """Status of the belief, then of the inputs.

        Parameters
        ----------
        tracker : whose estimates and counts are reported
        scan_file : the map in use
        inputs : what the tracker does not know about them
        """
        return [self._of_belief(tracker, scan_file, inputs.stale), self._of_inputs(tracker, inputs)]

    def progress(self, text: str, share: float) -> Any:
        """Progress of building the map."""
        message = f"{text}: {share:.0%}"
        return self._status("map", DiagnosticStatus.OK, message, {"share": f"{share:.2f}"})

    def _of_belief(self, tracker: OnlineLocalizer, scan_file: str, stale: str) -> Any:
        estimate = tracker.latest
        values: dict[str, Any] = {"scan_file": scan_file}
        if estimate is not None:
            values |= {
                "converged": estimate.converged and not stale,
                "reason": estimate.reason,
                "state": estimate.state.name,
                "probability": f"{estimate.probability:.4f}",
                "on_map": f"{estimate.on_map:.4f}",
                "log_marginal_nat": f"{estimate.log_marginal:.2f}",
                "covariance_trace": f"{estimate.trace:.4g}",
                "effective_sample_size": f"{estimate.effective_sample_size:.1f}",
                "hypotheses": estimate.hypotheses,
                "travel_m": f"{estimate.travel:.4f}",
                "inconsistent": " ".join(_inconsistent(tracker)),
            }
        strains, positions = tracker.fit.shares
        values |= {"strains_out_of_range": f"{strains:.2f}", "positions_out_of_range": f"{positions:.2f}"}
        if tracker.update_times_ns:
            times_us = np.asarray(tracker.update_times_ns) * 1e-3
            median, tail, worst = np.quantile(times_us, [0.5, 0.99, 1.0])
            values |= {
                "update_median_us": f"{median:.1f}",
                "update_p99_us": f"{tail:.1f}",
                "update_worst_us": f"{worst:.1f}",
            }
        if stale:
            return self._status("belief", DiagnosticStatus.STALE, f"stale: {stale}", values)
        if stuck := _inconsistent(tracker):
            message = f"not used because the load cell repeats itself (stuck): {', '.join(stuck)}"
            return self._status("belief", DiagnosticStatus.WARN, message, values)
        if tracker.fit.trouble:
            return self._status("belief", DiagnosticStatus.WARN, tracker.fit.trouble, values)
        if estimate is None:
            return self._status("belief", DiagnosticStatus.OK, "no measurement yet", values)
        adverse = estimate.state in (State.LOST, State.UNKNOWN)
        level = DiagnosticStatus.WARN if adverse else DiagnosticStatus.OK
        return self._status("belief", level, estimate.reason, values)

    def _of_inputs(self, tracker: OnlineLocalizer, inputs: Inputs) -> Any:
        counts = dataclasses.asdict(tracker.counts)
        absent = counts.pop("absent")
        pairing = tracker.pairing
        lost = {
            "strain vectors that never came": inputs.lost,
            "strain vectors without a pose": counts["gaps"],
            "strain vectors without a phalanx that is OK": counts["unusable"],
            "strain vectors that are not finite": counts["refused"],
            **{f"strain vectors without {phalanx}": count for phalanx, count in absent.items()},
            **{f"messages of {topic} that cannot be used": count for topic, count in inputs.unread.items()},
            "messages that came late": pairing.late,
            "times that stamps went back": pairing.resets,
            "times that stamps leapt ahead": tracker.leaps,
        }
        new = {what: count - self._lost.get(what, 0) for what, count in lost.items()}
        losses = ", ".join(f"{count} {what}" for what, count in new.items() if count > 0)
        self._lost = lost
        values = {
            **counts,
            **{f"absent_{phalanx}": count for phalanx, count in absent.items()},
            **{f"unread_{topic}": count for topic, count in inputs.unread.items()},
            "lost": inputs.lost,
            "late": pairing.late,
            "time_jumps": pairing.resets,
            "time_leaps": tracker.leaps,
            "waiting_s": f"{_waiting_s(pairing):.3f}",
            "trouble": tracker.trouble,
        }
        missing = inputs.stale or (f"no {' and no '.join(inputs.silent)}" if inputs.silent else "")
        message = "; ".join(filter(None, [missing, losses])) or "well"
        level = DiagnosticStatus.WARN if missing or losses else DiagnosticStatus.OK
        return self._status("inputs", DiagnosticStatus.ERROR if inputs.stale else level, message, values)

    def _status(self, what: str, level: bytes, message: str, values: Mapping[str, Any]) -> Any:
        pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        return DiagnosticStatus(
            level=level, name=f"{self._name}: {what}", message=message, hardware_id="", values=pairs
        )


def _inconsistent(tracker: OnlineLocalizer) -> list[str]:
    """Names of the phalanges that are stuck."""
    if tracker.latest is None:
        return []
    names = tracker.localizer.scene.phalanx_names
    consistent = tracker.latest.consistent
    return [name for name, used in zip(names, consistent, strict=True) if not used]


def _waiting_s(pairing: Pairing[Any]) -> float:
    """How long, by stamps, the oldest strain vector has waited for its pose; bounded by the patience."""
    if pairing.waiting_ns is None or pairing.newest_ns is None:
        return 0.0
    return (pairing.newest_ns - pairing.waiting_ns) / NANOSECONDS
