"""Where the trajectories of a belief come from, and what is known along them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tactile_localizer.core import compiled


class Ancestry(NamedTuple):
    """Where trajectories come from: those of P states, and those of R anchors, which continue themselves.

    A hand that is placed elsewhere was tracked: of what came to a trajectory from anywhere, the mean over the
    states before is known.

    Parameters
    ----------
    ancestors : (P,) int, the state before that each continues
    continued : (P,) fraction of its weight that comes from there; the rest came to it from anywhere
    placed : (R,) fraction of the weight of each anchor that came to it from anywhere
    weights : (Q,) of the states before
    """

    ancestors: np.ndarray
    continued: np.ndarray
    placed: np.ndarray
    weights: np.ndarray

    def followed(self, values: np.ndarray) -> np.ndarray:
        """What is known along the trajectories, of ``values`` of those before.

        These are (K, Q + R) or (K, Q + R, C) float32, with as many rows (K, P + R) then.
        """
        states, anchors = len(self.weights), len(self.placed)
        if compiled.MODULE is not None:
            after = len(self.ancestors) + anchors
            found = np.empty((len(values), after, *values.shape[2:]), dtype=np.float32)
            compiled.MODULE.follow(len(values), values, *self, found)
            return found
        own = values[..., None] if values.ndim == 2 else values
        mean = self.weights.astype(np.float32) @ own[:, :states]
        found = own.take(np.concatenate([self.ancestors, np.arange(states, states + anchors)]), axis=1)
        share = np.concatenate([1.0 - self.continued, self.placed]).astype(np.float32)[:, None]
        found *= 1.0 - share
        found += share * mean[:, None]
        return found[..., 0] if values.ndim == 2 else found
