"""Where the trajectories of a belief come from, and what is known along them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tactile_localizer.core import compiled


class Ancestry(NamedTuple):
    """Where M trajectories come from: those of the states, then those of the anchors.

    A hand that is placed elsewhere was tracked: of what came to a trajectory from anywhere, the mean over the
    states before is known.

    Parameters
    ----------
    ancestors : (M,) int, the trajectory of N before that each continues
    taken_in : (M,) fraction of its weight that came to it from anywhere instead
    weights : (P,) of the states before, the first of the N trajectories
    """

    ancestors: np.ndarray
    taken_in: np.ndarray
    weights: np.ndarray

    def followed(self, values: np.ndarray) -> np.ndarray:
        """What is known along the M trajectories, of ``values`` (K, N) or (K, N, C) float32 of N before."""
        if compiled.MODULE is not None:
            found = np.empty((len(values), len(self.ancestors), *values.shape[2:]), dtype=np.float32)
            compiled.MODULE.follow(len(values), values, *self, found)
            return found
        own = values[..., None] if values.ndim == 2 else values
        mean = self.weights.astype(np.float32) @ own[:, : len(self.weights)]
        found, share = own.take(self.ancestors, axis=1), self.taken_in.astype(np.float32)[:, None]
        found *= 1.0 - share
        found += share * mean[:, None]
        return found[..., 0] if values.ndim == 2 else found
