"""Blocks of cells: where a belief on a grid has no detail, several cells are one hypothesis."""

from __future__ import annotations

import numpy as np

from tactile_localizer.core.likelihood.base import flatten_axes

MOST_APART = 1500
"""Number of cells with weight up to which each is evaluated individually; blocks do not pay for fewer."""
_LITTLE = 1e-4
"""Weight of a cell, relative to the largest, below which it counts with its neighbours. By judgement; on
three simulated features, two seeds each, errors and convergence are those of every cell on its own."""


class Blocks:
    """Divides a grid into blocks of cells, of which those with little weight are one hypothesis each.

    A belief that covers most of the scene is wide, and one that has a peak has no detail away from it.

    Parameters
    ----------
    axes : centres of the cells along each axis, m (yaw: rad)
    cells : (d,) int, cells along each axis of a block
    """

    def __init__(self, axes: list[np.ndarray], cells: np.ndarray) -> None:
        firsts = [np.arange(0, len(axis), size) for axis, size in zip(axes, cells.tolist(), strict=True)]
        lasts = [np.append(first[1:], len(axis)) - 1 for first, axis in zip(firsts, axes, strict=True)]
        middles = [0.5 * (x[a] + x[b]) for x, a, b in zip(axes, firsts, lasts, strict=True)]
        self._centres = np.ascontiguousarray(flatten_axes(middles).T)
        of_axis = [np.arange(len(axis)) // size for axis, size in zip(axes, cells.tolist(), strict=True)]
        shape = tuple(len(middle) for middle in middles)
        self._block = np.ravel_multi_index(tuple(np.meshgrid(*of_axis, indexing="ij")), shape).ravel()
        self._kept: np.ndarray = np.zeros(0, dtype=np.intp)
        self.masses: np.ndarray = np.zeros(0)

    def divide(self, weights: np.ndarray) -> np.ndarray:
        """Which cells of ``weights`` (N,) are hypotheses of their own, (n,) int; others count by block."""
        apart = (weights > _LITTLE * weights.max()).nonzero()[0]
        if len(apart) > MOST_APART:
            apart = apart[:0]
        self._rest = weights.copy()
        self._rest[apart] = 0.0
        masses = np.bincount(self._block, self._rest, minlength=self._centres.shape[1])
        self._kept = masses.nonzero()[0]
        self.masses = masses.take(self._kept)
        return apart

    @property
    def centres(self) -> np.ndarray:
        """Centres (d, B) of the blocks that have weight."""
        return self._centres.take(self._kept, axis=1)

    def spread(self, masses: np.ndarray) -> np.ndarray:
        """New ``masses`` (B,) of the blocks, shared among their cells in proportion to weight, (N,)."""
        factors = np.zeros(self._centres.shape[1])
        factors[self._kept] = masses / self.masses
        return self._rest * factors.take(self._block)
