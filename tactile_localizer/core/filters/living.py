"""The cells of a grid that have weight."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tactile_localizer.core import compiled


class Living(NamedTuple):
    """The P cells of N that have weight.

    Parameters
    ----------
    cells : (P,) int, their indices
    states : (d, P) their centres
    weights : (P,) with a sum of one: what has next to no weight is dropped
    ancestors : (P,) int, number of the living cell that each was before; 0 where it was none
    continued : (P,) fraction of each weight that comes from its ancestor
    numbers : (N,) int, number of each cell among these; -1: it has no weight
    """

    cells: np.ndarray
    states: np.ndarray
    weights: np.ndarray
    ancestors: np.ndarray
    continued: np.ndarray
    numbers: np.ndarray

    @classmethod
    def of(
        cls,
        belief: np.ndarray,
        kept: np.ndarray,
        numbers: np.ndarray,
        centres: np.ndarray,
        offset: np.ndarray,
        least: float,
    ) -> Living:
        """The cells of a ``belief`` (N,) that have more than the ``least`` weight.

        Parameters
        ----------
        kept : (N,) what of the belief was not taken in from anywhere
        numbers : (N,) int, :attr:`numbers` before, where the cells are now
        centres, offset : (d, N) and (d,), of all cells, and by how much they are moved
        """
        if compiled.MODULE is not None:
            axes, count = centres.shape
            cells, ancestors, after = np.empty((3, count), dtype=np.intp)
            states, (weights, continued) = np.empty(axes * count), np.empty((2, count))
            given = belief, kept, numbers, centres, offset, least
            alive = compiled.MODULE.living(*given, cells, states, weights, ancestors, continued, after)
            states, own = states[: axes * alive].reshape(axes, alive), slice(alive)
            return cls(cells[own], states, weights[own], ancestors[own], continued[own], after)
        cells = (belief > least).nonzero()[0]
        after, alive = np.full(len(belief), -1), belief.take(cells)
        after[cells] = np.arange(len(cells))
        ancestors = numbers.take(cells)
        continued = np.where(ancestors < 0, 0.0, kept.take(cells) / alive)
        states = centres.take(cells, axis=1) + offset[:, None]
        weights = alive / np.add.reduce(alive)
        return cls(cells, states, weights, np.maximum(ancestors, 0), continued, after)
