"""The training pairs near one box of states, laid out so that sums over them are fast."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any

import numpy as np
from scipy import ndimage, sparse
from scipy.spatial.distance import cdist

from tactile_localizer.scene import GAUGES

NODES_PER_STD = 6
"""Grid nodes a standard deviation of the position kernel, an axis."""
REACH = 5.3
"""Standard deviations beyond which a position kernel is left out: it is below exp(-5.3^2 / 2) = 8e-7."""
_BANDED_ABOVE = 4
"""Axes longer than this many kernel widths are worth a sparse matrix."""
_MOST_INT32 = 2**31 - 1
_CHUNK = 2**22
_LARGEST_IN_FLOAT32 = 1e8
"""Squared length of whitened strains above which float32 rounds them by a thousandth of a kernel width."""


class PairBlock:
    """Pairs that matter for the states inside one box. All lengths are in kernel standard deviations.

    Parameters
    ----------
    positions : (M, d) where the pairs were felt
    strain : (8F, M) whitened strains, channels first: the product with one measurement reads memory in order
    lower, upper : (d,) the box of states that this block serves
    """

    def __init__(
        self, positions: np.ndarray, strain: np.ndarray, lower: np.ndarray, upper: np.ndarray
    ) -> None:
        self.lower, self.upper = lower, upper
        self.positions = positions
        self._strain = strain
        by_phalanx = strain.reshape(len(strain) // GAUGES, GAUGES, len(positions))
        self._square = np.einsum("fcn,fcn->fn", by_phalanx, by_phalanx)
        self._largest = float(self._square.sum(axis=0).max(initial=0.0))
        self._grid: KernelGrid | None = None
        self._density: Density | None = None

    def __len__(self) -> int:
        return len(self.positions)

    @cached_property
    def nodes(self) -> int:
        """How many nodes the grid has, or would have."""
        return math.prod(KernelGrid.shape_for(self.positions))

    @property
    def grid(self) -> KernelGrid:
        """The nodes that weights are spread on; made when first needed."""
        if self._grid is None:
            self._grid = KernelGrid(self.positions, self._strain.dtype)
        return self._grid

    @property
    def density(self) -> Density:
        """The sum of the position kernels alone, for states in the box; made when first needed."""
        if self._density is None:
            self._density = Density(self)
        return self._density

    def serves(self, lower: np.ndarray, upper: np.ndarray) -> bool:
        """Whether the box ``lower`` (d,) to ``upper`` (d,) lies inside this block's."""
        return bool((lower >= self.lower).all() and (upper <= self.upper).all())

    def strain_weights(self, strain: np.ndarray, present: np.ndarray) -> tuple[np.ndarray, float]:
        """exp(-||z - z_n||^2 / 2) of every pair, scaled so that the largest is one.

        Parameters
        ----------
        strain : (8F,) whitened
        present : (F,) bool, the phalanges to count

        Returns
        -------
        weights : (M,)
        log_scale : logarithm of what they were divided by, so that nothing underflows
        """
        distances = self._squared_distances(strain, present)
        nearest = float(distances.min())
        distances -= distances.dtype.type(nearest)
        distances *= -0.5
        return np.exp(distances, out=distances), -0.5 * nearest

    def _squared_distances(self, strain: np.ndarray, present: np.ndarray) -> np.ndarray:
        if present.all():
            square = self._square[0] if len(present) == 1 else self._square.sum(axis=0)
        else:
            strain = np.where(np.repeat(present, GAUGES), strain, 0.0)
            square = self._square[present].sum(axis=0)
        dtype = self._strain.dtype
        size = float(strain @ strain)
        # ||z||^2 - 2 z.z_n + ||z_n||^2 takes one pass over the strains but cancels. Where that could cost a
        # hundredth (the measurement is far from the whole scan, or float32 is short) subtract first.
        if 8.0 * float(np.finfo(dtype).eps) * (size + self._largest) < 1e-2:
            distances = strain.astype(dtype, copy=False) @ self._strain
            distances *= -2.0
            distances += square
            distances += dtype.type(size)
            return distances
        if size + self._largest > _LARGEST_IN_FLOAT32:
            dtype = np.dtype(np.float64)
        distances = np.zeros(len(self), dtype=dtype)
        for channel in np.flatnonzero(np.repeat(present, GAUGES)):
            difference = self._strain[channel].astype(dtype, copy=False) - dtype.type(strain[channel])
            difference *= difference
            distances += difference
        return distances

    def direct_sum(self, states: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Sum of weights (M,) or (M, k) times position kernel at states (P, d): (P,) or (P, k)."""
        rows = max(1, _CHUNK // len(self))
        parts = []
        for start in range(0, len(states), rows):
            kernel = cdist(states[start : start + rows], self.positions, "sqeuclidean")
            kernel *= -0.5
            parts.append(np.exp(kernel, out=kernel) @ weights)
        return np.concatenate(parts)


class Density:
    """The sum of the position kernels of a block's pairs: tabulated once, then cubic splines.

    Parameters
    ----------
    block : its pairs; states are expected inside its box, and see zero outside
    """

    _NODES_PER_STD = 4

    def __init__(self, block: PairBlock) -> None:
        self._start = block.lower - 1.0 / self._NODES_PER_STD
        counts = np.ceil((block.upper - block.lower) * self._NODES_PER_STD).astype(np.int64) + 3
        axes = [
            start + np.arange(count) / self._NODES_PER_STD
            for start, count in zip(self._start, counts, strict=True)
        ]
        ones = np.ones(len(block), dtype=np.float64)
        self._coefficients = ndimage.spline_filter(
            block.grid.on_axes(axes, block.grid.spread(ones)), mode="mirror"
        )

    def __call__(self, states: np.ndarray) -> np.ndarray:
        """At states (P, d): (P,)."""
        coordinates = ((states - self._start) * self._NODES_PER_STD).T
        values = ndimage.map_coordinates(self._coefficients, coordinates, prefilter=False, mode="constant")
        return np.maximum(values, 0.0)


class KernelGrid:
    """A regular grid over pairs, and Gaussian kernel sums between its nodes and any states.

    A weight is spread on the 3^d nodes nearest to its pair by quadratic B-splines (h the node spacing, in
    standard deviations). Wherever the pair lies between the nodes, that widens the kernel by a variance of
    h^2 / 4; the kernel is narrowed by as much. What is left is of third order: at most 0.003 in the logarithm
    of a lone pair's kernel down to 5 nats below its peak.

    Parameters
    ----------
    positions : (M, d) pairs, in standard deviations of the kernel
    dtype : of the weights and kernels
    """

    _TAPS = 3

    def __init__(self, positions: np.ndarray, dtype: np.dtype[Any]) -> None:
        spacing = 1.0 / NODES_PER_STD
        low = positions.min(axis=0) - spacing
        scaled = (positions - low) / spacing
        self.shape = self.shape_for(positions)
        self._dtype = dtype
        self._nodes = [low[axis] + spacing * np.arange(size) for axis, size in enumerate(self.shape)]
        narrowed = 1.0 - spacing**2 / 4.0
        self._factor = -0.5 / narrowed
        self._peak = 1.0 / math.sqrt(narrowed)
        self._taps = self._spreading(scaled)

    @staticmethod
    def shape_for(positions: np.ndarray) -> tuple[int, ...]:
        """Nodes along each axis of a grid over ``positions`` (M, d)."""
        extent = positions.max(axis=0) - positions.min(axis=0)
        return tuple(int(cells) + 4 for cells in extent * NODES_PER_STD)

    def _spreading(self, scaled: np.ndarray) -> sparse.csc_array:
        """The spreading as a sparse matrix (nodes, pairs)."""
        pairs, d = scaled.shape
        nearest = np.rint(scaled).astype(np.int32)
        offset = scaled - nearest
        splines = np.stack([0.5 * (0.5 - offset) ** 2, 0.75 - offset**2, 0.5 * (0.5 + offset) ** 2])
        corners = self._TAPS**d
        rows = np.zeros((pairs, corners), dtype=np.int32)
        taps = np.ones((pairs, corners), dtype=self._dtype)
        for corner, steps in enumerate(np.ndindex(*(self._TAPS,) * d)):
            for axis, step in enumerate(steps):
                rows[:, corner] = rows[:, corner] * self.shape[axis] + nearest[:, axis] + (step - 1)
                taps[:, corner] *= splines[step, :, axis]
        pointers = (
            np.arange(pairs + 1, dtype=np.int64 if pairs * corners > _MOST_INT32 else np.int32) * corners
        )
        return sparse.csc_array((taps.ravel(), rows.ravel(), pointers), shape=(math.prod(self.shape), pairs))

    def spread(self, weights: np.ndarray) -> np.ndarray:
        """Weights of the pairs (M,) on the nodes: an array of the grid's shape."""
        return (self._taps @ weights).reshape(self.shape)

    def at_states(self, states: np.ndarray, field: np.ndarray) -> np.ndarray:
        """A field (G1, ..., Gd) summed with the kernel at states (P, d) -> (P,)."""
        field = field.reshape(self.shape[0], -1)
        rows = max(1, _CHUNK // field.shape[1])
        parts = [self._contract(states[start : start + rows], field) for start in range(0, len(states), rows)]
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    def _contract(self, states: np.ndarray, field: np.ndarray) -> np.ndarray:
        total = self._kernel(states[:, 0], 0) @ field
        for axis in range(1, len(self.shape)):
            kernel = self._dense(states[:, axis], axis)
            total = np.einsum("pg,pgr->pr", kernel, total.reshape(len(states), self.shape[axis], -1))
        return total[:, 0]

    def on_axes(self, axes: list[np.ndarray], field: np.ndarray) -> np.ndarray:
        """The same at every combination of d coordinates -> (C1, ..., Cd)."""
        total = field
        for axis, coordinates in enumerate(axes):
            rest = total.shape[1:]
            total = (self._kernel(coordinates, axis) @ total.reshape(len(total), -1)).reshape(-1, *rest)
            # The axis that was contracted goes last, so after d turns the order is right again.
            total = np.moveaxis(total, 0, -1)
        return total

    def _kernel(self, coordinates: np.ndarray, axis: int) -> np.ndarray | sparse.csr_array:
        """Kernel between coordinates (C,) and an axis's nodes, (C, G): banded where most of it is nothing."""
        nodes = self._nodes[axis]
        width = 2 * math.ceil(REACH * NODES_PER_STD) + 1
        if len(nodes) < _BANDED_ABOVE * width:
            return self._dense(coordinates, axis)
        first = np.rint((coordinates - nodes[0]) * NODES_PER_STD).astype(np.int64) - width // 2
        columns = np.clip(first, 0, len(nodes) - width)[:, None] + np.arange(width)
        values = self._gaussian(coordinates[:, None] - nodes[columns])
        pointers = np.arange(len(coordinates) + 1) * width
        return sparse.csr_array(
            (values.ravel(), columns.ravel(), pointers), shape=(len(coordinates), len(nodes))
        )

    def _dense(self, coordinates: np.ndarray, axis: int) -> np.ndarray:
        return self._gaussian(np.subtract.outer(coordinates, self._nodes[axis]))

    def _gaussian(self, difference: np.ndarray) -> np.ndarray:
        kernel = difference.astype(self._dtype, copy=False)
        kernel *= kernel
        kernel *= self._dtype.type(self._factor)
        np.exp(kernel, out=kernel)
        kernel *= self._dtype.type(self._peak)
        return kernel
