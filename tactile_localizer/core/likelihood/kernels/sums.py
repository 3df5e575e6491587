"""Kernel sums of the sum-of-Gaussians model (paper, Eq. 4), evaluated in three ways.

For one measurement the strain distances ``||z - z_n||^2`` do not depend on the state and are computed once.
The position kernel, which differs between states, is summed

- ``exact``: directly over all pairs, as the reference;
- ``truncated``: directly over the pairs within :data:`.REACH` of the bounding box of the states;
- ``field``: over the same pairs after spreading their weights on a grid, on which the kernel is separable and
  the sum becomes a few small matrix products (:class:`.KernelGrid`); directly if a grid that is fine enough
  would be more work.
"""

from __future__ import annotations

import math

import numpy as np

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.geometry.angles import wrap_angle
from tactile_localizer.core.likelihood.base import flatten_axes
from tactile_localizer.core.likelihood.kernels import EVALUATIONS, PRECISIONS
from tactile_localizer.core.likelihood.kernels.grid import REACH, box
from tactile_localizer.core.likelihood.kernels.pair_block import PairBlock
from tactile_localizer.errors import ParameterError

_MARGIN = 3.0
"""Standard deviations by which the box of a block exceeds the states, so that it serves several updates."""
_WORTH_SHRINKING = 0.5
"""Fraction of the pairs below which a smaller block is worth making."""
_ROWS = 512
"""Strains transposed at once, which fit the processor's cache."""
_NODES_PER_PAIR = 100
"""Grid nodes whose matrix product costs as much as one pair summed directly, per state."""
_MOST_NODES = 2**26


class KernelSum:
    """For one measurement, sums over the training pairs of strain kernel times position kernel.

    Parameters
    ----------
    positions, strain : (N, d) m (yaw: rad) and (N, C) V, the training pairs
    position_std : (d,) square root of the diagonal of the paper's Sigma_x
    strain_std : (C,) square root of the diagonal of the paper's Sigma_z
    wraps : (d,) bool, axes that are a full turn
    layout : channels of the strain by phalanx
    evaluation : one of :data:`EVALUATIONS`
    precision : of the strains in memory, one of :data:`PRECISIONS`

    Raises
    ------
    ParameterError
        An unknown evaluation or precision.
    """

    def __init__(
        self,
        positions: np.ndarray,
        strain: np.ndarray,
        position_std: np.ndarray,
        strain_std: np.ndarray,
        wraps: np.ndarray,
        layout: ChannelLayout,
        evaluation: str = "field",
        precision: str = "float64",
    ) -> None:
        if evaluation not in EVALUATIONS:
            raise ParameterError(f"evaluation {evaluation!r}: expected one of {', '.join(EVALUATIONS)}")
        if precision not in PRECISIONS:
            raise ParameterError(f"precision {precision!r}: expected one of {', '.join(PRECISIONS)}")
        self.evaluation = evaluation
        self.position_std = np.asarray(position_std, dtype=np.float64)
        self._strain_std = np.asarray(strain_std, dtype=np.float64)
        self._dtype = np.dtype(precision)
        self._wraps, self._layout = wraps, layout
        # Any point amid the strains: it keeps whitened strains short.
        self._centre = strain[:: max(1, len(strain) // _ROWS)].mean(axis=0)
        rows, unrolled = unroll(positions, wraps, REACH * self.position_std)
        order = np.argsort(unrolled[:, 0], kind="stable")
        self._positions = unrolled[order]
        self._positions /= self.position_std
        self._first, self._last = (corner.tolist() for corner in box(self._positions))
        rows = rows[order]
        del unrolled, order  # frees memory before the strains of a large map are copied
        self._strain = self._whitened(strain, rows)
        self._block: PairBlock | None = None
        self._held = 0.0
        log_widths = self._layout.sum(np.log(self._strain_std))
        self._log_constants = -0.5 * math.log(2.0 * math.pi) * np.array(self._layout.counts) - log_widths

    def _whitened(self, strain: np.ndarray, order: np.ndarray) -> np.ndarray:
        """Strains (C, N) in units of the kernel widths, in the order of the positions."""
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
        """Kernel sums for one strain vector.

        Parameters
        ----------
        states : (P, d) m (yaw: rad, any turn of a full-turn axis)
        strain : (C,) V
        present : (F,) bool, phalanges that count
        log_floor : logarithm of a term that the caller adds to the sums; pairs that are negligible beside it
            may be omitted

        Returns
        -------
        sums : (P,) sums of position kernel, one at its centre, times strain kernel, up to a factor
        density : (P,) sums of the position kernel alone
        log_scale : logarithm of the factor that makes ``sums`` a density over z
        """
        if self._wraps.any():
            states = np.where(self._wraps, wrap_angle(states), states)
        scaled = states / self.position_std
        block = self._block_for(*box(scaled))
        if len(block) == 0:
            return np.zeros(len(states)), np.zeros(len(states)), 0.0
        if self.evaluation == "field" and block.nodes <= min(_NODES_PER_PAIR * len(block), _MOST_NODES):
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
        """As :meth:`at_states`, at every combination of the coordinates of d axes: arrays (C1, ..., Cd)."""
        shape = tuple(len(coordinates) for coordinates in axes)
        axes = [wrap_angle(c) if wraps else c for c, wraps in zip(axes, self._wraps, strict=True)]
        states = flatten_axes(axes)
        scaled = [coordinates / std for coordinates, std in zip(axes, self.position_std, strict=True)]
        block = self._block_for(np.array([c.min() for c in scaled]), np.array([c.max() for c in scaled]))
        # The grid is contracted with the first axis alone; a direct sum is over all states and pairs.
        most_nodes = min(_NODES_PER_PAIR * len(block) * (len(states) / len(axes[0])), _MOST_NODES)
        if self.evaluation != "field" or len(block) == 0 or block.nodes > most_nodes:
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
        """The pairs within reach of a box; the last block, if it covers the box and is not much larger."""
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
        """Volume of the part of the scan within reach of a box, a measure of the number of its pairs."""
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
    """Indices and positions, with the pairs near the ends of full-turn axes repeated one turn away."""
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
