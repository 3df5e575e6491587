"""Training pairs near a box of states, arranged for fast sums over them."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from scipy.spatial.distance import cdist

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.likelihood.kernels.grid import REACH, KernelGrid, TabulatedField, box

HEADROOM = 64.0
"""Logarithm of the largest weight, so that float32 represents weights smaller by a factor of exp(-150)."""
_LEAST = np.float32(-69.0)
"""Least logarithm of a weight: computing with denormal numbers is slow."""
_ALWAYS_KEPT = 1.0
"""nats below the largest weight within which pairs are kept in any case."""
_FEW = 0.15
"""Fraction of the pairs below which selecting them is less work than using all."""
_CHUNK = 2**16
"""Kernels computed at once, which fit the processor's cache."""
_LARGEST_IN_FLOAT32 = 1e8
"""Squared length of whitened strains above which float32 rounds them by a thousandth of a kernel width."""


class PairBlock:
    """Pairs that matter for the states inside a box. All lengths are in kernel standard deviations.

    Parameters
    ----------
    positions : (M, d) of the pairs
    strain : (C, M) whitened strains, channels first, so that the product with a measurement is contiguous
    lower, upper : (d,) the box of states; infinite beyond the last pairs
    layout : channels of the strain by phalanx
    """

    def __init__(
        self,
        positions: np.ndarray,
        strain: np.ndarray,
        lower: np.ndarray,
        upper: np.ndarray,
        layout: ChannelLayout,
    ) -> None:
        self.lower, self.upper = lower, upper
        self.positions = positions
        self._strain = strain
        self._layout = layout
        self._half_squares = 0.5 * np.stack(
            [np.einsum("cn,cn->n", own, own) for own in (strain[mine] for mine in self._layout.slices)]
        )
        self._half_square = self._half_squares.sum(axis=0)
        self._largest = 2.0 * float(self._half_square.max(initial=0.0))

    def __len__(self) -> int:
        return len(self.positions)

    @cached_property
    def nodes(self) -> int:
        """Number of nodes of :attr:`grid`, which need not have been made."""
        low, high = box(self.positions)
        return math.prod(KernelGrid.shape_for(high - low))

    @cached_property
    def grid(self) -> KernelGrid:
        """Grid over the pairs."""
        return KernelGrid(self.positions)

    @cached_property
    def count(self) -> np.ndarray:
        """The pairs spread on the grid with weight one."""
        return self.grid.spread(np.ones(len(self)))

    @cached_property
    def density(self) -> TabulatedField:
        """Sum of the position kernels alone, for states in the box."""
        low, high = box(self.positions)
        lower, upper = np.maximum(self.lower, low - REACH), np.minimum(self.upper, high + REACH)
        return TabulatedField(self.grid, self.count, lower, upper)

    def serves(self, lower: np.ndarray, upper: np.ndarray) -> bool:
        """Whether the box from ``lower`` (d,) to ``upper`` (d,) lies inside this block's."""
        inside = zip(lower.tolist(), upper.tolist(), self.lower.tolist(), self.upper.tolist(), strict=True)
        return all(low >= least and high <= most for low, high, least, most in inside)

    def strain_weights(
        self, strain: np.ndarray, present: np.ndarray, log_negligible: float = -math.inf
    ) -> tuple[np.ndarray | None, np.ndarray, float]:
        """Strain kernels exp(-||z - z_n||^2 / 2), scaled to prevent underflow.

        Parameters
        ----------
        strain : (C,) whitened
        present : (F,) bool, phalanges that count
        log_negligible : logarithm of a sum; weights that add up to less than 1e-4 of it may be omitted

        Returns
        -------
        pairs : (M',) indices of the other weights; ``None``: all, if few can be omitted
        weights : (M',) or (M,); the largest is exp(:data:`HEADROOM`)
        log_scale : logarithm of the factor by which they were divided
        """
        exponents, offset = self._exponents(strain, present)
        nearest = float(exponents.max())
        least = log_negligible - offset - math.log(1e4 * len(self))
        pairs = None
        if least > -math.inf:
            heavy = exponents > min(least, nearest - _ALWAYS_KEPT)
            if np.count_nonzero(heavy) < _FEW * len(self):
                pairs = np.flatnonzero(heavy)
                exponents = exponents[pairs]
        exponents -= exponents.dtype.type(nearest)
        exponents += exponents.dtype.type(HEADROOM)
        np.maximum(exponents, _LEAST, out=exponents)
        return pairs, np.exp(exponents, out=exponents), offset + nearest - HEADROOM

    def spread(self, pairs: np.ndarray | None, weights: np.ndarray) -> np.ndarray:
        """The weights of :meth:`strain_weights` on the nodes of the grid."""
        return self.grid.spread(weights) if pairs is None else self.grid.spread_some(pairs, weights)

    def _exponents(self, strain: np.ndarray, present: np.ndarray) -> tuple[np.ndarray, float]:
        """-||z - z_n||^2 / 2 of every pair up to an offset, (M,), and the offset."""
        channels = slice(None)
        half_square = self._half_square
        if not present.all():
            strain = np.where(self._layout.expand(present), strain, 0.0)
            half_square = self._half_squares[present].sum(axis=0)
            first, last = np.flatnonzero(present)[[0, -1]]
            channels = slice(self._layout.slices[first].start, self._layout.slices[last].stop)
        dtype = self._strain.dtype
        size = float(strain @ strain)
        # z.z_n - ||z_n||^2 / 2 takes one pass over the strains but suffers from cancellation. Where the error
        # could exceed 0.01 (a measurement far from the scan, or float32), differences are computed instead.
        if 8.0 * float(np.finfo(dtype).eps) * (size + self._largest) < 1e-2:
            exponents = strain[channels].astype(dtype, copy=False) @ self._strain[channels]
            exponents -= half_square
            return exponents, -0.5 * size
        if size + self._largest > _LARGEST_IN_FLOAT32:
            dtype = np.dtype(np.float64)
        exponents = np.zeros(len(self), dtype=dtype)
        for channel in np.flatnonzero(self._layout.expand(present)):
            difference = self._strain[channel].astype(dtype, copy=False) - dtype.type(strain[channel])
            difference *= difference
            exponents += difference
        exponents *= -0.5
        return exponents, 0.0

    def direct_sum(self, states: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Sum of weights (M, k) times position kernel at states (P, d): (P, k)."""
        rows = max(1, _CHUNK // len(self))
        parts = []
        for start in range(0, len(states), rows):
            kernel = cdist(states[start : start + rows], self.positions, "sqeuclidean")
            kernel *= -0.5
            parts.append(np.exp(kernel, out=kernel) @ weights)
        return np.concatenate(parts)
