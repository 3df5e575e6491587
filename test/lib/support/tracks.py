"""Synthetic tracks of a localizer, for tests of metrics."""

from __future__ import annotations

import numpy as np

from tactile_localizer.core.hypotheses.convergence import State
from tactile_localizer.io.recording import NO_CONTACT
from tactile_localizer.offline.replay import Track
from tactile_localizer.scene import Axis, Phalanx, Scene

SHEET = Scene("sheet", (Axis("x", 0.0, 0.05), Axis("y", 0.0, 0.05)), (Phalanx("index", (0.0, 0.0)),))
SAMPLES = 50


def made_track(
    mean: np.ndarray,
    std: np.ndarray | float,
    truth: np.ndarray | None,
    *,
    converged: np.ndarray | None = None,
    contact: tuple[int, int] = NO_CONTACT,
    **others: object,
) -> Track:
    """Entries 1 mm of travel apart; ``others`` replace the rest of a :class:`Track`."""
    n, d = mean.shape
    flags = np.zeros(n, dtype=bool) if converged is None else np.asarray(converged)
    fields: dict[str, object] = {
        "number": 0,
        "row": np.arange(n),
        "stamp_ns": np.arange(n, dtype=np.int64),
        "mean": mean,
        "covariance": np.broadcast_to(std, n)[:, None, None] ** 2 * np.eye(d),
        "state": tuple(State.CONVERGED if flag else State.SEARCHING for flag in flags),
        "probability": np.zeros(n),
        "on_map": np.zeros(n),
        "log_marginal": np.zeros(n),
        "updated": np.ones(n, dtype=bool),
        "moved": 0.001 * np.arange(n),
        "consistent": np.ones((n, 1), dtype=bool),
        "reason": ("",) * n,
        "truth": truth,
        "travel": 0.001 * np.arange(n),
        "seconds": np.full(n, 1e-4),
        "refused": 0,
        "contact": contact,
    }
    return Track(**{**fields, **others})  # type: ignore[arg-type]


def sheet_track(contact: tuple[int, int] = (20, 39)) -> Track:
    """A sweep sampled each 1 mm along x and 10 ms: off by 10 mm until sample 20, by 1 mm from then on."""
    truth = np.column_stack([0.0005 + 0.001 * np.arange(SAMPLES), np.full(SAMPLES, 0.02)])
    error = np.where(np.arange(SAMPLES) < 20, 0.010, 0.001)
    return made_track(
        truth + np.column_stack([np.zeros(SAMPLES), error]),
        error,
        truth,
        converged=(np.arange(SAMPLES) >= 25) & (np.arange(SAMPLES) < 45),
        contact=contact,
        stamp_ns=np.arange(SAMPLES, dtype=np.int64) * 10**7,
        log_marginal=np.linspace(10.0, 59.0, SAMPLES),
    )
