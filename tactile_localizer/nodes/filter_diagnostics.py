"""What the filter tells about itself once a second: its belief, its work, its inputs."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from tactile_localizer.nodes.tracker import Tracker


class FilterDiagnostics:
    """Makes the diagnostics of a filter node; warns of what was lost since the last call.

    Parameters
    ----------
    name : of the node, before each status's own name
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._lost: dict[str, int] = {}

    def statuses(self, tracker: Tracker, scan_file: str, stale: str, unread: Mapping[str, int]) -> list[Any]:
        """The belief, then the inputs.

        Parameters
        ----------
        tracker : what is told about
        scan_file : the map in use
        stale : why the position is stale; empty when it is not
        unread : messages that could not be used at all, by topic
        """
        return [self._of_belief(tracker, scan_file, stale), self._of_inputs(tracker, stale, unread)]

    def _of_belief(self, tracker: Tracker, scan_file: str, stale: str) -> Any:
        estimate = tracker.latest
        values: dict[str, Any] = {"scan_file": scan_file}
        if estimate is not None:
            values |= {
                "converged": estimate.converged and not stale,
                "reason": estimate.reason,
                "evidence_nat": f"{estimate.evidence:.2f}",
                "log_marginal_nat": f"{estimate.log_marginal:.2f}",
                "covariance_trace": f"{estimate.trace:.4g}",
                "effective_sample_size": f"{estimate.effective_sample_size:.1f}",
                "hypotheses": estimate.hypotheses,
                "travel_m": f"{estimate.travel:.4f}",
                "left_out": " ".join(_left_out(tracker)),
            }
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
        if left_out := _left_out(tracker):
            message = f"left out, for they contradict the belief: {', '.join(left_out)}"
            return self._status("belief", DiagnosticStatus.WARN, message, values)
        message = "nothing felt yet" if estimate is None else estimate.reason
        return self._status("belief", DiagnosticStatus.OK, message, values)

    def _of_inputs(self, tracker: Tracker, stale: str, unread: Mapping[str, int]) -> Any:
        counts = dataclasses.asdict(tracker.counts)
        absent = counts.pop("absent")
        pairing = tracker.pairing
        lost = {
            "strain vectors without a pose": counts["gaps"],
            "strain vectors without a phalanx that is well": counts["unusable"],
            "strain vectors that are not finite": counts["refused"],
            **{f"strain vectors without {phalanx}": count for phalanx, count in absent.items()},
            **{f"messages of {topic} that cannot be used": count for topic, count in unread.items()},
            "messages that came late": pairing.late,
        }
        new = {what: count - self._lost.get(what, 0) for what, count in lost.items()}
        told = ", ".join(f"{count} {what}" for what, count in new.items() if count > 0)
        self._lost = lost
        values = {
            **counts,
            **{f"absent_{phalanx}": count for phalanx, count in absent.items()},
            **{f"unread_{topic}": count for topic, count in unread.items()},
            "late": pairing.late,
            "time_jumps": pairing.resets,
            "trouble": tracker.trouble,
        }
        if stale:
            return self._status("inputs", DiagnosticStatus.ERROR, stale, values)
        if told:
            return self._status("inputs", DiagnosticStatus.WARN, told, values)
        return self._status("inputs", DiagnosticStatus.OK, "well", values)

    def _status(self, what: str, level: bytes, message: str, values: Mapping[str, Any]) -> Any:
        told = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        return DiagnosticStatus(
            level=level, name=f"{self._name}: {what}", message=message, hardware_id="", values=told
        )


def _left_out(tracker: Tracker) -> list[str]:
    """Phalanges that are not trusted."""
    if tracker.latest is None:
        return []
    names = tracker.localizer.scene.phalanx_names
    return [name for name, trusted in zip(names, tracker.latest.trusted, strict=True) if not trusted]
