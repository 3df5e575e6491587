"""Diagnostics of the filter node: state and cost of the belief, and state of the inputs."""

from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus

from tactile_localizer.core.hypotheses.convergence import State
from tactile_localizer.core.scan.range import describe_misfit
from tactile_localizer.ros.diagnostics.status import DiagnosticsPublisher, Increments
from tactile_localizer.ros.online_localizer import USED, OnlineLocalizer
from tactile_localizer.ros.subscriptions.tactile_inputs import TactileInputs


class FilterDiagnostics:
    """Makes the statuses of a filter node; losses since the previous status are a warning.

    Parameters
    ----------
    publisher : publisher of the statuses
    """

    def __init__(self, publisher: DiagnosticsPublisher) -> None:
        self._publisher = publisher
        self._losses = Increments()

    def belief(self, online: OnlineLocalizer, scan_file: str, stale: str) -> DiagnosticStatus:
        """Status of the belief of a localizer on the map ``scan_file``."""
        estimate, stuck = online.latest, list[str]()
        strains, positions = online.out_of_range
        values: dict[str, Any] = {"scan_file": scan_file}
        if estimate is not None:
            names = online.localizer.scene.phalanx_names
            stuck += [name for name, ok in zip(names, estimate.consistent, strict=True) if not ok]
            values |= {
                "reason": estimate.reason,
                "state": estimate.state.name,
                "probability": f"{estimate.probability:.4f}",
                "on_map": f"{estimate.on_map:.4f}",
                "travel_m": f"{estimate.travel:.4f}",
                "converged": estimate.converged and not stale,
                "inconsistent": " ".join(stuck),
            }
        values |= {"strains_out_of_range": f"{strains:.2f}", "positions_out_of_range": f"{positions:.2f}"}
        if online.update_times_ns:
            times_us = np.asarray(online.update_times_ns) * 1e-3
            for name, time_us in zip(("median", "p99"), np.quantile(times_us, [0.5, 0.99]), strict=True):
                values[f"update_{name}_us"] = f"{time_us:.1f}"
        level, message = DiagnosticStatus.OK, "no measurement yet"
        if stale:
            level, message = DiagnosticStatus.STALE, f"stale: {stale}"
        elif stuck:
            level = DiagnosticStatus.WARN
            message = f"stuck load cells, not used: {', '.join(stuck)} (strain repeats exactly)"
        elif misfit := describe_misfit(strains, positions):
            level, message = DiagnosticStatus.WARN, misfit
        elif estimate is not None:
            message = estimate.reason
            if estimate.state in (State.LOST, State.UNKNOWN):
                level = DiagnosticStatus.WARN
        return self._publisher.status("belief", level, message, values)

    def inputs(
        self, inputs: TactileInputs, online: OnlineLocalizer, problem: str, is_stale: bool
    ) -> DiagnosticStatus:
        """Status of the inputs: their ``problem``, empty if there is none; whether the estimate is stale."""
        counts, session = online.counts, inputs.session
        losses = {
            **{f"strain vectors {what}": counts[what] for what in counts if what not in USED},
            **{f"invalid messages on {topic}": count for topic, count in inputs.invalid.items()},
            **{f"spikes in {gauge}": count for gauge, count in online.localizer.spikes.items()},
            "strain vectors lost in transport": inputs.lost,
            "late messages": session.late,
            "backward jumps of the stamps": session.resets,
            "forward jumps of the stamps": session.forward_jumps,
        }
        values = {**{name: counts[name] for name in USED}, **losses, "last_error": online.last_error}
        message = "; ".join(filter(None, [problem, ", ".join(self._losses.describe(losses))]))
        level = (
            DiagnosticStatus.ERROR if is_stale else DiagnosticStatus.WARN if message else DiagnosticStatus.OK
        )
        return self._publisher.status("inputs", level, message or "OK", values)
