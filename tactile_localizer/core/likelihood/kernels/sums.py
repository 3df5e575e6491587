"""The kernel sums of the sum-of-Gaussians model (paper, Eq. 4), evaluated in three ways.

For one measurement the strain distances ``||z - z_n||^2`` do not depend on the state: they are computed
once. What differs between states is the position kernel, summed

- ``exact``: directly, over all pairs: the reference;
- ``truncated``: directly, over the pairs within :data:`~.kernel_grid.REACH` of the box that holds the states;
- ``field``: over the same pairs, after spreading their weights on a grid on which the kernel is separable,
  so that the sum becomes a few small matrix products (:class:`~.kernel_grid.KernelGrid`); directly, where a
  grid fine enough would have so many nodes that it is more work.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.geometry.angles import wrap_angle
from tactile_localizer.core.likelihood.base import flatten_axes
from tactile_localizer.core.likelihood.kernels import EVALUATIONS
from tactile_localizer.core.likelihood.kernels.grid import REACH, box
from tactile_localizer.core.likelihood.kernels.pair_block import PairBlock
from tactile_localizer.errors import ParameterError

_MARGIN = 3.0
"""Standard deviations that a block serves beyond the states it was made for, so that it lasts for updates."""
_WORTH_SHRINKING = 0.5
"""Share of the pairs that a smaller block must come down to, to be worth making."""
_ROWS = 512
"""Strains transposed at once: they stay in the processor's cache."""
_NODES_A_PAIR = 100
"""Nodes of a grid that cost, at each state, as much as one pair directly: a product is cheap."""
_MOST_NODES = 2**26


class KernelSum:
    """For one measurement, sums over the training pairs of strain kernel times position kernel.

    Parameters
    ----------
    positions : (N, d) where the pairs were felt, m (yaw: rad)
    strain : (N, C) what was felt, V
    position_std : (d,) square root of the diagonal of the paper's Sigma_x
    strain_std : (C,) square root of the diagonal of the paper's Sigma_z
    wraps : (d,) bool, axes that are a full turn
    evaluation : one of :data:`EVALUATIONS`
    dtype : of the strains in memory: float64, or float32 for half the traffic
    layout : the strains' channels by phalanx; ``None``: the default channels each
    """

    def __init__(
        self,
        positions: np.ndarray,
        strain: np.ndarray,
        position_std: np.ndarray,
        strain_std: np.ndarray,
        wraps: np.ndarray,
        evaluation: str = "field",
        dtype: Any = np.float64,
        layout: ChannelLayout | None = None,
    ) -> None:
        if evaluation not in EVALUATIONS:
            raise ParameterError(f"evaluation {evaluation!r}: expected one of {', '.join(EVALUATIONS)}")
        self.evaluation = evaluation
        self.position_std = np.asarray(position_std, dtype=np.float64)
        self._strain_std = np.asarray(strain_std, dtype=np.float64)
        self._dtype = np.dtype(dtype)
        self._wraps = wraps
        self._layout = layout or ChannelLayout.default(strain.shape[1])
        # Any point amid the strains will do: it keeps whitened strains short.
        self._centre = strain[:: max(1, len(strain) // _ROWS)].mean(axis=0)
        rows, unrolled = unroll(positions, wraps, REACH * self.position_std)
        order = np.argsort(unrolled[:, 0], kind="stable")
        self._positions = unrolled[order]
        self._positions /= self.position_std
        self._first, self._last = (corner.tolist() for corner in box(self._positions))
        rows = rows[order]
        del unrolled, order  # of a large map, memory that the strains are about to need
        self._strain = self._whitened(strain, rows)
        self._block: PairBlock | None = None
        self._held = 0.0
        log_widths = self._layout.sum(np.log(self._strain_std))
        self._log_constants = -0.5 * math.log(2.0 * math.pi) * np.array(self._layout.counts) - log_widths

    def _whitened(self, strain: np.ndarray, order: np.ndarray) -> np.ndarray:
        """Strains in units of the kernel widths, channels first, in the order of the positions: (C, N)."""
        white = np.empty((strain.shape[1], len(order)), dtype=self._dtype)
        for start in range(0, len(order), _ROWS):
            part = strain[order[start : start + _ROWS]]
            white[:, start : start + _ROWS] = ((part - self._centre) / self._strain_std).T
        return white

    def at_states(
        self,
        states: np.ndarray,
        strain: np.ndarray,
        present: np.ndarray,
        log_floor: float = -math.inf,
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """The sums at states (P, d), m, for a strain (C,), V, of the phalanges ``present`` (F,) bool.

        A full-turn axis is periodic: any turn of it will do. ``log_floor``: logarithm of what will be added
        to the sums; pairs that are negligible beside it may be left out.

        Returns
        -------
        sums : (P,) position kernel (one at its centre) times strain kernel, but for its scale
        density : (P,) the position kernel alone
        log_scale : logarithm of the factor that makes ``sums`` a density over z
        """
        if self._wraps.any():
            states = np.where(self._wraps, wrap_angle(states), states)
        scaled = states / self.position_std
        block = self._block_for(*box(scaled))
        if len(block) == 0:
            return np.zeros(len(states)), np.zeros(len(states)), 0.0
        if self.evaluation == "field" and block.nodes <= min(_NODES_A_PAIR * len(block), _MOST_NODES):
            pairs, weights, log_scale = self._weights(block, strain, present, log_floor)
            field = block.spread(pairs, weights)
            return block.grid.at_states(scaled, field), block.density(scaled), log_scale
        _, weights, log_scale = self._weights(block, strain, present, -math.inf)
        both = block.direct_sum(scaled, np.stack([weights, np.ones(len(weights))], axis=1))
        return both[:, 0], both[:, 1], log_scale

    def on_axes(
        self,
        axes: list[np.ndarray],
        strain: np.ndarray,
        present: np.ndarray,
        log_floor: float = -math.inf,
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """The same at every combination of d coordinates: arrays (C1, ..., Cd)."""
        shape = tuple(len(coordinates) for coordinates in axes)
        axes = [wrap_angle(c) if wraps else c for c, wraps in zip(axes, self._wraps, strict=True)]
        states = flatten_axes(axes)
        scaled = [coordinates / std for coordinates, std in zip(axes, self.position_std, strict=True)]
        block = self._block_for(np.array([c.min() for c in scaled]), np.array([c.max() for c in scaled]))
        # The grid is contracted with the first axis alone; directly, every state meets every pair.
        worth = _NODES_A_PAIR * len(block) * (len(states) / len(axes[0]))
        if self.evaluation != "field" or len(block) == 0 or block.nodes > min(worth, _MOST_NODES):
            sums, density, log_scale = self.at_states(states, strain, present, log_floor)
            return sums.reshape(shape), density.reshape(shape), log_scale
        pairs, weights, log_scale = self._weights(block, strain, present, log_floor)
        sums = block.grid.on_axes(scaled, block.spread(pairs, weights))
        return sums, np.maximum(block.grid.on_axes(scaled, block.count), 0.0), log_scale

    def _weights(
        self, block: PairBlock, strain: np.ndarray, present: np.ndarray, log_floor: float
    ) -> tuple[np.ndarray | None, np.ndarray, float]:
        white = (strain - self._centre) / self._strain_std
        log_constant = float(self._log_constants[present].sum())
        pairs, weights, log_scale = block.strain_weights(white, present, log_floor - log_constant)
        return pairs, weights, log_scale + log_constant

    def _block_for(self, lower: np.ndarray, upper: np.ndarray) -> PairBlock:
        """The pairs within reach of the box, kept while they serve and are not far too many."""
        block, exact = self._block, self.evaluation == "exact"
        if (
            block is not None
            and block.serves(lower, upper)
            and (exact or self._volume(lower - _MARGIN, upper + _MARGIN) >= _WORTH_SHRINKING * self._held)
        ):
            return block
        lower, upper = lower - _MARGIN, upper + _MARGIN
        everywhere = np.full_like(lower, np.inf)
        if exact or self._volume(lower, upper) >= _WORTH_SHRINKING * self._volume(-everywhere, everywhere):
            lower, upper = -everywhere, everywhere
        self._held = self._volume(lower, upper)
        self._block = self._make_block(lower, upper)
        return self._block

    def _volume(self, lower: np.ndarray, upper: np.ndarray) -> float:
        """Volume that the pairs of a block for this box take up: a measure of their number."""
        sides = zip(lower.tolist(), upper.tolist(), self._first, self._last, strict=True)
        return math.prod(
            max(min(high + REACH, last) - max(low - REACH, first), 1e-3) for low, high, first, last in sides
        )

    def _make_block(self, lower: np.ndarray, upper: np.ndarray) -> PairBlock:
        if np.isinf(lower).all() and np.isinf(upper).all():
            return PairBlock(self._positions, self._strain, lower, upper, self._layout)
        first, last = np.searchsorted(self._positions[:, 0], [lower[0] - REACH, upper[0] + REACH])
        near = self._positions[first:last]
        keep = np.ones(len(near), dtype=bool)
        for coordinates, low, high in zip(near.T, lower - REACH, upper + REACH, strict=True):
            keep &= (coordinates >= low) & (coordinates <= high)
        rows = first + np.flatnonzero(keep)
        strain = np.take(self._strain, rows, axis=1)
        return PairBlock(self._positions[rows], strain, lower, upper, self._layout)


def unroll(positions: np.ndarray, wraps: np.ndarray, reach: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Indices and positions with the pairs near the ends of full-turn axes repeated a turn away."""
    index = np.arange(len(positions))
    for axis in np.flatnonzero(wraps):
        turns = []
        for turn in (-2 * math.pi, 2 * math.pi):
            moved = positions[:, axis] + turn
            within = np.abs(moved) <= math.pi + min(float(reach[axis]), math.pi)
            copy = positions[within].copy()
            copy[:, axis] += turn
            turns.append((index[within], copy))
        index = np.concatenate([index, *(rows for rows, _ in turns)])
        positions = np.concatenate([positions, *(copy for _, copy in turns)])
    return index, positions
