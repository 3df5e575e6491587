"""Synthetic tracks of a localizer, for tests of metrics."""

from __future__ import annotations

import numpy as np

from tactile_localizer.core.hypotheses.convergence import State
from tactile_localizer.io.recording import NO_CONTACT
from tactile_localizer.offline.replay import Track


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
        "reason": ("",) * n,
        "truth": truth,
        "travel": 0.001 * np.arange(n),
        "seconds": np.full(n, 1e-4),
        "refused": 0,
        "contact": contact,
    }
    return Track(**{**fields, **others})  # type: ignore[arg-type]
