"""Gaussian kernel sums between weights on a regular grid and any states, as small matrix products."""

from __future__ import annotations

import math

import numpy as np
from scipy import ndimage, sparse

NODES_PER_STD = 6
"""Grid nodes per standard deviation of the position kernel, along each axis."""
REACH = 5.3
"""Standard deviations beyond which a position kernel is neglected: it is below exp(-5.3^2 / 2) = 8e-7."""
_BAND = 12.0
"""Standard deviations beyond which a kernel is neglected on long axes: below exp(-72)."""
_BANDED_ABOVE = 3
"""Length of an axis, in bands, above which a sparse matrix is faster."""
_MOST_INT32 = 2**31 - 1
_CHUNK = 2**22
"""Kernels computed at once."""
_ROWS = 2**11
"""Pairs spread at once, whose arrays fit the processor's cache."""


def box(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Bounding box of points (N, d): (d,) each."""
    # One axis at a time is much faster than a reduction over rows.
    return np.array([axis.min() for axis in points.T]), np.array([axis.max() for axis in points.T])


class KernelGrid:
    """Regular grid over pairs, for Gaussian kernel sums between its nodes and any states.

    A weight is spread on the 3^d nodes nearest to its pair by quadratic B-splines. Wherever the pair lies
    between the nodes, that widens the kernel by a variance of h^2 / 4, with h the node spacing in standard
    deviations; the kernel is narrowed by as much. The remaining error is of third order: at most 0.003 in the
    logarithm of a single pair's kernel down to 5 nats below its peak. The rounding of float32 is smaller.

    Parameters
    ----------
    positions : (M, d) pairs, in standard deviations of the kernel
    """

    def __init__(self, positions: np.ndarray) -> None:
        spacing = 1.0 / NODES_PER_STD
        low, high = box(positions)
        self._low = low - spacing
        self.shape = self.shape_for(high - low)
        self._nodes = [(spacing * np.arange(size)).astype(np.float32) for size in self.shape]
        narrowed = 1.0 - spacing**2 / 4.0
        self._factor = np.float32(-0.5 / narrowed)
        self._peak = narrowed ** (-0.5 * len(self.shape))
        self._taps = self._spreading((positions - self._low) / spacing)

    @staticmethod
    def shape_for(extent: np.ndarray) -> tuple[int, ...]:
        """Nodes along each axis of a grid over pairs whose bounding box has the size ``extent`` (d,)."""
        return tuple(int(cells) + 4 for cells in extent * NODES_PER_STD)

    def _spreading(self, scaled: np.ndarray) -> sparse.csc_array:
        """Sparse matrix (nodes, pairs) that spreads weights."""
        pairs, corners = len(scaled), 3 ** len(self.shape)
        rows = np.empty((pairs, corners), dtype=np.int32)
        taps = np.empty((pairs, corners), dtype=np.float32)
        for start in range(0, pairs, _ROWS):
            part = slice(start, start + _ROWS)
            rows[part], taps[part] = self._stencils(scaled[part])
        integer = np.int64 if rows.size > _MOST_INT32 else np.int32
        pointers = np.arange(0, rows.size + 1, corners, dtype=integer)
        return sparse.csc_array((taps.ravel(), rows.ravel(), pointers), shape=(math.prod(self.shape), pairs))

    def _stencils(self, scaled: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Indices of the nodes around each pair and their weights: (n, 3^d) each."""
        rows = np.zeros((len(scaled), 1), dtype=np.int32)
        taps = np.ones((len(scaled), 1), dtype=np.float32)
        for size, coordinates in zip(self.shape, scaled.T, strict=True):
            nearest = np.rint(coordinates)
            offset = (coordinates - nearest).astype(np.float32)
            splines = np.stack(
                [0.5 * (0.5 - offset) ** 2, 0.75 - offset**2, 0.5 * (0.5 + offset) ** 2], axis=1
            )
            steps = nearest.astype(np.int32)[:, None] + np.arange(-1, 2, dtype=np.int32)
            rows = (rows[:, :, None] * np.int32(size) + steps[:, None, :]).reshape(len(scaled), -1)
            taps = (taps[:, :, None] * splines[:, None, :]).reshape(len(scaled), -1)
        return rows, taps

    def spread(self, weights: np.ndarray) -> np.ndarray:
        """Weights of the pairs (M,) spread on the nodes, an array of the grid's shape."""
        return (self._taps @ weights.astype(np.float32, copy=False)).reshape(self.shape)

    def spread_some(self, pairs: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """As :meth:`spread`, of a few pairs, with their indices and weights (M',)."""
        corners = 3 ** len(self.shape)
        nodes = self._taps.indices.reshape(-1, corners)[pairs]
        taps = self._taps.data.reshape(-1, corners)[pairs] * weights[:, None]
        spread = np.bincount(nodes.ravel(), taps.ravel(), minlength=self._taps.shape[0])
        return spread.astype(np.float32).reshape(self.shape)

    def at_states(self, states: np.ndarray, field: np.ndarray) -> np.ndarray:
        """Kernel sums (P,) of a field (G1, ..., Gd) at states (P, d)."""
        field = field.reshape(self.shape[0], -1)
        rows = max(1, _CHUNK // field.shape[1])
        parts = [self._contract(states[start : start + rows], field) for start in range(0, len(states), rows)]
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    def _contract(self, states: np.ndarray, field: np.ndarray) -> np.ndarray:
        total = self._kernel(states[:, 0], 0) @ field
        for axis in range(1, len(self.shape)):
            kernel = self._dense(states[:, axis], axis)
            total = np.einsum("pg,pgr->pr", kernel, total.reshape(len(states), self.shape[axis], -1))
        return self._peak * total[:, 0].astype(np.float64)

    def on_axes(self, axes: list[np.ndarray], field: np.ndarray) -> np.ndarray:
        """Kernel sums of a field at every combination of the coordinates of d axes, (C1, ..., Cd)."""
        total = field
        for axis, coordinates in enumerate(axes):
            rest = total.shape[1:]
            total = (self._kernel(coordinates, axis) @ total.reshape(len(total), -1)).reshape(-1, *rest)
            # The contracted axis goes last, so that after d turns the order is restored.
            total = np.moveaxis(total, 0, -1)
        return self._peak * total.astype(np.float64)

    def _kernel(self, coordinates: np.ndarray, axis: int) -> np.ndarray | sparse.csr_array:
        """Kernel between coordinates (C,) and the nodes of an axis, (C, G), banded on a long axis."""
        nodes = self._nodes[axis]
        width = 2 * math.ceil(_BAND * NODES_PER_STD) + 1
        if len(nodes) < _BANDED_ABOVE * width:
            return self._dense(coordinates, axis)
        place = coordinates - self._low[axis]
        first = np.rint(place * NODES_PER_STD).astype(np.int64) - width // 2
        columns = np.clip(first, 0, len(nodes) - width)[:, None] + np.arange(width)
        values = self._gaussian(place.astype(np.float32)[:, None] - nodes[columns])
        pointers = np.arange(len(coordinates) + 1) * width
        return sparse.csr_array(
            (values.ravel(), columns.ravel(), pointers), shape=(len(coordinates), len(nodes))
        )

    def _dense(self, coordinates: np.ndarray, axis: int) -> np.ndarray:
        place = (coordinates - self._low[axis]).astype(np.float32)
        return self._gaussian(np.subtract.outer(place, self._nodes[axis]))

    def _gaussian(self, difference: np.ndarray) -> np.ndarray:
        difference *= difference
        difference *= self._factor
        np.exp(difference, out=difference)
        return difference


class TabulatedField:
    """Kernel sums of a constant field, tabulated once and interpolated by cubic splines.

    Parameters
    ----------
    grid, field : the field (G1, ..., Gd) and its grid
    lower, upper : (d,) box of the states; outside of it the sums are zero
    """

    _NODES_PER_STD = 4

    def __init__(self, grid: KernelGrid, field: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> None:
        self._start = lower - 1.0 / self._NODES_PER_STD
        counts = np.ceil((upper - lower) * self._NODES_PER_STD).astype(np.int64) + 3
        axes = [
            start + np.arange(count) / self._NODES_PER_STD
            for start, count in zip(self._start, counts, strict=True)
        ]
        self._coefficients = ndimage.spline_filter(grid.on_axes(axes, field), mode="mirror")

    def __call__(self, states: np.ndarray) -> np.ndarray:
        """At states (P, d): (P,)."""
        coordinates = ((states - self._start) * self._NODES_PER_STD).T
        values = ndimage.map_coordinates(self._coefficients, coordinates, prefilter=False, mode="constant")
        return np.maximum(values, 0.0)
