"""Outcome of a live sweep over a simulated feature: error on contact, and convergence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactile_localizer.offline.metrics import INCH
from tactile_localizer.sim.scan import sweep_plan
from tactile_localizer.sim.sweep import simulate_sweep

LIMIT_M = 0.1 * INCH
"""Error after contact reported in the paper, a tenth of an inch, m."""


@dataclass(frozen=True)
class Contact:
    """Positions along x between which the feature exceeds the noise, m."""

    first: float
    last: float


@dataclass(frozen=True)
class LiveSweep:
    """The n estimates of a sweep, in the order of their stamps, and the truth at these stamps.

    Parameters
    ----------
    number : number of the sweep
    stamp_ns : (n,) int64
    mean, truth : (n, 2) m, x and y
    trace : (n,) trace of the covariance, m²
    converged : (n,) bool
    contact : contact with the feature; ``None`` if the sweep passes beside it
    """

    number: int
    stamp_ns: np.ndarray
    mean: np.ndarray
    truth: np.ndarray
    trace: np.ndarray
    converged: np.ndarray
    contact: Contact | None

    @property
    def error(self) -> np.ndarray:
        """Distance between estimate and truth, (n,), m."""
        return np.linalg.norm(self.mean - self.truth, axis=1)

    @property
    def after_contact(self) -> np.ndarray:
        """Whether the palm is between contact and the end of the feature, (n,) bool."""
        if self.contact is None:
            return np.zeros(len(self.stamp_ns), dtype=bool)
        return (self.truth[:, 0] >= self.contact.first) & (self.truth[:, 0] <= self.contact.last)

    def outcome(self) -> dict[str, Any]:
        """Errors and convergence, by name; ``None`` for an undefined value."""
        during = self.after_contact
        travel = np.abs(self.truth[:, 0] - self.truth[0, 0])
        first = int(np.argmax(self.converged)) if self.converged.any() else None
        contact_m = None if self.contact is None else self.contact.first
        return {
            "sweep": self.number,
            "start_mm": (self.truth[0] * 1e3).round(2),
            "error_after_contact_mm": _mean_mm(self.error[during]),
            "error_converged_mm": _mean_mm(self.error[during & self.converged]),
            "converged": bool(self.converged[during].any()),
            "converged_before_contact": first is not None
            and (contact_m is None or bool(self.truth[first, 0] < contact_m)),
            "time_to_convergence_s": None
            if first is None
            else 1e-9 * float(self.stamp_ns[first] - self.stamp_ns[0]),
            "travel_to_convergence_mm": None if first is None else 1e3 * float(travel[first]),
        }


def contact_of(feature: str, seed: int, number: int, speed: float, rate: float) -> Contact | None:
    """Contact of a simulated test sweep with the feature; ``None`` if it passes beside it."""
    start, end = sweep_plan("test", number, seed)
    sweep = simulate_sweep(feature, seed, number, "test", start=start, end=end, speed=speed, rate=rate)
    if sweep.contact < 0:
        return None
    return Contact(float(sweep.truth[sweep.contact, 0]), float(sweep.truth[sweep.feature_end, 0]))


def summarize(sweeps: Sequence[LiveSweep]) -> dict[str, Any]:
    """Means over the sweeps, by name; ``within_limit``: the mean error after contact is at most 0.1 inch."""
    outcomes = [sweep.outcome() for sweep in sweeps]
    mean = _mean(outcomes, "error_after_contact_mm")
    return {
        "error_after_contact_mm": mean,
        "error_converged_mm": _mean(outcomes, "error_converged_mm"),
        "within_limit": mean is not None and mean <= LIMIT_M * 1e3,
        "converged_sweeps": sum(one["converged"] for one in outcomes),
        "converged_before_contact": sum(one["converged_before_contact"] for one in outcomes),
        "time_to_convergence_s": _mean(outcomes, "time_to_convergence_s"),
        "travel_to_convergence_mm": _mean(outcomes, "travel_to_convergence_mm"),
        "sweeps": outcomes,
    }


def _mean_mm(error: np.ndarray) -> float | None:
    """Mean of errors in m, converted to mm; ``None`` if there are none."""
    return 1e3 * float(error.mean()) if len(error) else None


def _mean(outcomes: Sequence[dict[str, Any]], name: str) -> float | None:
    values = [one[name] for one in outcomes if one[name] is not None]
    return float(np.mean(values)) if values else None
