"""Motion of a belief on the cells of a grid: shifted by whole cells, and spread."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tactile_localizer.core import compiled

_THREE_POINT = 0.6
"""Variance, in cells squared, up to which three points represent a Gaussian step."""


class MovedCells(NamedTuple):
    """The cells of a grid after a motion.

    Parameters
    ----------
    belief : (shape) weights with a sum of one; of a belief that has left the grid, even ones
    numbers : (shape) int, of the cells that were there before; -1 where there were none
    kept : fraction of the belief that is still on the grid
    """

    belief: np.ndarray
    numbers: np.ndarray
    kept: float

    @classmethod
    def of(
        cls,
        belief: np.ndarray,
        numbers: np.ndarray,
        shift: Sequence[int],
        variance: Sequence[float],
        wraps: np.ndarray,
    ) -> MovedCells:
        """Those of a ``belief`` (shape) with a sum of one, and of cells with ``numbers`` (shape).

        Diffusion between cells does not change a cell's number.

        Parameters
        ----------
        shift : of d axes, in cells
        variance : of d axes, by which the belief spreads, in cells squared
        wraps : (d,) bool, axes whose last cell is beside the first one
        """
        if compiled.MODULE is not None and max(variance) <= _THREE_POINT:
            after, numbers_after = np.empty(belief.shape), np.empty(belief.shape, dtype=np.intp)
            how = np.array(belief.shape), np.array(shift), np.array(variance), wraps
            kept = compiled.MODULE.move_cells(belief, numbers, *how, after, numbers_after)
            return cls(after, numbers_after, kept)
        if any(shift):
            belief, numbers = _shifted(belief, shift, wraps, 0.0), _shifted(numbers, shift, wraps, -1)
        for axis, each in enumerate(variance):
            if each:
                belief = _spread(belief, axis, each, bool(wraps[axis]))
        kept = float(np.add.reduce(belief, axis=None))
        even = np.full(belief.shape, 1.0 / belief.size)
        return cls(belief / kept if kept > 0.0 else even, numbers, kept)


def _shifted(values: np.ndarray, cells: Sequence[int], wraps: np.ndarray, empty: float) -> np.ndarray:
    """Values of the cells that were there before the cells moved, ``empty`` where there were none."""
    to, of = [slice(None)] * len(cells), [slice(None)] * len(cells)
    for axis, count in enumerate(cells):
        if count and wraps[axis]:
            values = np.roll(values, count, axis=axis)
        elif count > 0:
            to[axis], of[axis] = slice(count, None), slice(None, -count)
        elif count < 0:
            to[axis], of[axis] = slice(None, count), slice(-count, None)
    shifted = np.full_like(values, empty)
    shifted[tuple(to)] = values[tuple(of)]
    return shifted


def _spread(belief: np.ndarray, axis: int, variance: float, wraps: bool) -> np.ndarray:
    """A belief spread by a variance, in cells squared: a small one by three points, which is exact."""
    # A spread as wide as the axis is as good as any wider one.
    variance = min(variance, float(belief.shape[axis]) ** 2)
    if variance > _THREE_POINT:
        from scipy.ndimage import convolve1d

        return np.asarray(convolve1d(belief, _step(variance), axis, mode="wrap" if wraps else "constant"))
    spread, beside = (1.0 - variance) * belief, 0.5 * variance * belief
    to, of = spread.swapaxes(0, axis), beside.swapaxes(0, axis)
    to[1:] += of[:-1]
    to[:-1] += of[1:]
    if wraps:
        to[0] += of[-1]
        to[-1] += of[0]
    return spread


def _step(variance: float) -> np.ndarray:
    """Weights of a Gaussian step of a variance, in cells squared, to four deviations."""
    reach = int(4.0 * math.sqrt(variance) + 0.5)
    kernel = np.exp(-0.5 * np.arange(-reach, reach + 1) ** 2 / variance)
    return kernel / kernel.sum()
