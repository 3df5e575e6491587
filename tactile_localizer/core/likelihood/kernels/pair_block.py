"""The training pairs near one box of states, laid out so that sums over them are fast."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from scipy.spatial.distance import cdist

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.likelihood.kernels.grid import REACH, Density, KernelGrid, box

HEADROOM = 64.0
"""Logarithm of the nearest pair's weight, so that float32 still holds weights smaller by exp(-150)."""
_LEAST = np.float32(-69.0)
"""Least logarithm of a weight, 133 nats below the nearest pair's: denormal numbers are slow."""
_NEAREST = 1.0
"""Nats below the nearest pair's weight that are kept in any case."""
_FEW = 0.15
"""Share of the pairs below which it is less work to pick them out."""
_CHUNK = 2**16
"""Kernels held at once: they stay in the processor's cache."""
_LARGEST_IN_FLOAT32 = 1e8
"""Squared length of whitened strains above which float32 rounds them by a thousandth of a kernel width."""


class PairBlock:
    """Pairs that matter for the states inside one box. All lengths are in kernel standard deviations.

    Parameters
    ----------
    positions : (M, d) where the pairs were felt
    strain : (C, M) whitened strains, channels first: the product with one measurement reads memory in order
    lower, upper : (d,) the box of states that this block serves; infinite where there are no more pairs
    layout : the strains' channels by phalanx; ``None``: the default channels each
    """

    def __init__(
        self,
        positions: np.ndarray,
        strain: np.ndarray,
        lower: np.ndarray,
        upper: np.ndarray,
        layout: ChannelLayout | None = None,
    ) -> None:
        self.lower, self.upper = lower, upper
        self.positions = positions
        self._strain = strain
        self._layout = layout or ChannelLayout.default(len(strain))
        self._half_squares = 0.5 * np.stack(
            [np.einsum("cn,cn->n", own, own) for own in (strain[mine] for mine in self._layout.slices)]
        )
        self._half_square = self._half_squares.sum(axis=0)
        self._largest = 2.0 * float(self._half_square.max(initial=0.0))

    def __len__(self) -> int:
        return len(self.positions)

    @cached_property
    def nodes(self) -> int:
        """How many nodes the grid has, or would have."""
        low, high = box(self.positions)
        return math.prod(KernelGrid.shape_for(high - low))

    @cached_property
    def grid(self) -> KernelGrid:
        """The nodes that weights are spread on; made when first needed."""
        return KernelGrid(self.positions)

    @cached_property
    def count(self) -> np.ndarray:
        """The pairs themselves spread on the grid, each with weight one."""
        return self.grid.spread(np.ones(len(self)))

    @cached_property
    def density(self) -> Density:
        """The sum of the position kernels alone, for states in the box; made when first needed."""
        low, high = box(self.positions)
        lower, upper = np.maximum(self.lower, low - REACH), np.minimum(self.upper, high + REACH)
        return Density(self.grid, self.count, lower, upper)

    def serves(self, lower: np.ndarray, upper: np.ndarray) -> bool:
        """Whether the box ``lower`` (d,) to ``upper`` (d,) lies inside this block's."""
        inside = zip(lower.tolist(), upper.tolist(), self.lower.tolist(), self.upper.tolist(), strict=True)
        return all(low >= least and high <= most for low, high, least, most in inside)

    def strain_weights(
        self, strain: np.ndarray, present: np.ndarray, log_negligible: float = -math.inf
    ) -> tuple[np.ndarray | None, np.ndarray, float]:
        """exp(-||z - z_n||^2 / 2) of the pairs, scaled so that nothing that matters underflows.

        Parameters
        ----------
        strain : (C,) whitened
        present : (F,) bool, the phalanges to count
        log_negligible : logarithm of a weight beside which the sum of all that are left out is below 1e-4

        Returns
        -------
        pairs : (M',) indices of those that are not negligible; ``None``: all, where they are not few
        weights : (M',) or (M,); the largest is exp(:data:`HEADROOM`)
        log_scale : logarithm of what they were divided by
        """
        exponents, offset = self._exponents(strain, present)
        nearest = float(exponents.max())
        least = log_negligible - offset - math.log(1e4 * len(self))
        pairs = None
        if least > -math.inf:
            heavy = exponents > min(least, nearest - _NEAREST)
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
        """-||z - z_n||^2 / 2 of every pair but for an offset: (M,) and the offset."""
        felt = slice(None)
        half_square = self._half_square
        if not present.all():
            strain = np.where(self._layout.expand(present), strain, 0.0)
            half_square = self._half_squares[present].sum(axis=0)
            first, last = np.flatnonzero(present)[[0, -1]]
            felt = slice(self._layout.slices[first].start, self._layout.slices[last].stop)
        dtype = self._strain.dtype
        size = float(strain @ strain)
        # z.z_n - ||z_n||^2 / 2 takes one pass over the strains but cancels. Where that could cost a hundredth
        # (the measurement is far from the whole scan, or float32 is short) subtract first.
        if 8.0 * float(np.finfo(dtype).eps) * (size + self._largest) < 1e-2:
            exponents = strain[felt].astype(dtype, copy=False) @ self._strain[felt]
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
