"""Replayed sweeps with known errors."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from tactile_localizer.core.hypotheses.convergence import ConvergenceCriteria, State
from tactile_localizer.offline.replay import ReplayedSweep
from tactile_localizer.scene import Axis, Phalanx, Scene

SHEET = Scene("sheet", (Axis("x", 0.0, 0.1), Axis("y", 0.0, 0.1)), (Phalanx("index", (0.0, 0.0)),))


def replayed(
    errors: Any,
    *,
    converged: Sequence[bool] | None = None,
    truth: bool = True,
    std: float = 0.001,
    **values: Any,
) -> ReplayedSweep:
    """Estimates 1 mm of travel apart that are off by ``errors`` (n, 2), m; every other one is an update."""
    errors = np.asarray(errors, dtype=float)
    n = len(errors)
    places = np.zeros((n, 2))
    places[:, 0] = 0.001 * np.arange(n)
    flags = np.zeros(n, dtype=bool) if converged is None else converged
    return ReplayedSweep(
        **{
            "scene": SHEET,
            "criteria": ConvergenceCriteria(np.array([0.0075, 0.0075])),
            "number": 0,
            "row": np.arange(n),
            "stamp_ns": np.arange(n, dtype=np.int64),
            "mean": places + errors,
            "covariance": np.broadcast_to(std**2 * np.eye(2), (n, 2, 2)),
            "state": tuple(State.CONVERGED if flag else State.SEARCHING for flag in flags),
            "probability": np.zeros(n),
            "on_map": np.zeros(n),
            "log_marginal": np.zeros(n),
            "updated": np.arange(n) % 2 == 0,
            "reason": ("not converged: too early",) * n,
            "truth": places if truth else None,
            "travel": places[:, 0],
            "seconds": np.where(np.arange(n) % 2 == 0, 1e-3, 1e-5),
            "refused": 0,
            **values,
        }
    )
