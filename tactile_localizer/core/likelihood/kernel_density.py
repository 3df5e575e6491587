"""Kernel density of the strain given the position, at the nodes of a lattice (paper, Eq. 4).

A sparse matrix, built once, spreads the training pairs on the nodes around them; the position kernel between
nodes is separable. So a measurement takes one weight per pair, a few small matrix products for the nodes
near the states, and linear interpolation of the log-likelihood from these to the states.
"""

from __future__ import annotations

import math
from itertools import product

import numpy as np
from scipy import ndimage, sparse
from scipy.spatial.distance import cdist

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.geometry.angles import wrap_angle
from tactile_localizer.core.likelihood.background import FLOOR, Background
from tactile_localizer.errors import ParameterError

MAX_NODES = 2**24
"""Largest number of nodes, for which the density of the scan takes 134 MB."""
_MAX_NODES_ALONG = 512
"""Nodes along an axis that are evaluated together; states that are farther apart are divided."""
_PAIR_NODES_PER_STD = 4
"""Nodes per kernel width on which pairs are spread: at most 0.01 nats off down to 5 nats below the peak."""
_NODES_PER_STD = 6
"""Nodes per kernel width between which log-likelihoods are interpolated: at most 0.03 nats off, likewise."""
_REACH = 8.5
"""Kernel widths beyond which a position kernel is neglected: it is below exp(-36)."""
_MARGIN = 5.0
"""Kernel widths around the pairs that have nodes; farther away the background is all that is left."""
_LOG_LARGEST, _LOG_SMALLEST = 64.0, -45.0
"""Logarithms of the largest and the smallest weight of a pair, whose sums and products are normal float32."""


class KernelDensity:
    """Kernel density of the strain given the position, with the background as its floor.

    .. math:: p(z | x) = (S(x, z) + a\\, b(z)) / (D(x) + a)

    where S is the sum over pairs of position kernel (one at its centre) times strain kernel, D the sum of the
    position kernel alone and b the :class:`.Background`. ``a`` is :data:`.FLOOR` times the D of an evenly
    spread scan, so that the background alone remains where nothing was scanned.

    Parameters
    ----------
    positions, strain : (N, d) m (yaw: rad, in [-pi, pi)) and (N, C) V, the training pairs
    position_std, strain_std : (d,) and (C,) kernel widths, square roots of the diagonals of S_x and S_z
    wraps : (d,) bool, axes that are a full turn
    layout : channels of the strain by phalanx
    conditional : whether to divide by D(x); ``False``: the paper's form with constant P(x), where D is that
        of an evenly spread scan everywhere

    Raises
    ------
    ParameterError
        Too many nodes for the memory.
    """

    def __init__(
        self,
        positions: np.ndarray,
        strain: np.ndarray,
        position_std: np.ndarray,
        strain_std: np.ndarray,
        wraps: np.ndarray,
        layout: ChannelLayout,
        *,
        conditional: bool = True,
    ) -> None:
        self.background = Background(strain, strain_std, layout)
        self._position_std, self._strain_std = position_std, strain_std
        self._wraps, self._layout = wraps, layout
        self._log_constants = -0.5 * math.log(2.0 * math.pi) * layout.widths - layout.sum(np.log(strain_std))
        order = np.argsort(positions[:, 0], kind="stable")
        scaled = positions[order] / position_std
        self._first_axis = scaled[:, 0]
        self._strain = strain[order] / strain_std
        turns = np.where(wraps, 2.0 * math.pi / position_std, math.inf)
        self._axes = [_LatticeAxis(along, turn) for along, turn in zip(scaled.T, turns, strict=True)]
        shape = tuple(axis.count for axis in self._axes)
        if math.prod(shape) > MAX_NODES:
            raise ParameterError(
                f"position_std {position_std}: expected at most {MAX_NODES:,} nodes for the {len(scaled):,} "
                f"pairs of the scan, got {math.prod(shape):.3g}; use wider kernels (is the scan in mm?)"
            )
        self._spread = self._spreading(scaled)
        kernel = math.sqrt(2.0 * math.pi)
        typical = len(scaled) * float(np.prod(kernel / np.maximum(np.ptp(scaled, axis=0), kernel)))
        self._floor = FLOOR * typical
        self._log_density = np.full(shape, math.log(typical + self._floor))
        if conditional:
            sums = self._spread @ np.ones(len(scaled), dtype=np.float32)
            for block in product(*(range(0, count, _MAX_NODES_ALONG) for count in shape)):
                ends = np.minimum(np.add(block, _MAX_NODES_ALONG), shape).tolist()
                density = self._at_nodes(sums, list(zip(block, ends, strict=True)))
                self._log_density[tuple(map(slice, block, ends))] = np.log(density + self._floor)

    def _spreading(self, scaled: np.ndarray) -> sparse.csc_array:
        """Sparse matrix (nodes, pairs) that spreads weights of the pairs at ``scaled`` (N, d)."""
        rows = np.zeros((len(scaled), 1), dtype=np.int32)
        taps = np.ones((len(scaled), 1), dtype=np.float32)
        for axis, along in zip(self._axes, scaled.T, strict=True):
            nodes, weights = axis.spread(along)
            rows = (rows[:, :, None] * axis.pair_count + nodes[:, None, :]).reshape(len(scaled), -1)
            taps = (taps[:, :, None] * weights[:, None, :]).reshape(len(scaled), -1)
        starts = np.arange(0, rows.size + 1, rows.shape[1])
        shape = math.prod(axis.pair_count for axis in self._axes), len(scaled)
        return sparse.csc_array((taps.ravel(), rows.ravel(), starts), shape=shape)

    def log_density(self, states: np.ndarray, strain: np.ndarray, present: np.ndarray) -> np.ndarray:
        """Log-density (P,) of a strain (C,) of the phalanges ``present`` (F,) at states (P, d)."""
        if self._wraps.any():
            states = np.where(self._wraps, wrap_angle(states), states)
        scaled = (states / self._position_std).T
        places = np.stack([axis.places(along) for axis, along in zip(self._axes, scaled, strict=True)])
        return self._interpolated(places, strain, present)

    def _interpolated(self, places: np.ndarray, strain: np.ndarray, present: np.ndarray) -> np.ndarray:
        """Log-densities (P,) at ``places`` (d, P), in nodes from the first one."""
        first = places.min(axis=1).astype(int)
        last = np.minimum(places.max(axis=1).astype(int) + 2, self._log_density.shape)
        if (last - first).max() > _MAX_NODES_ALONG:
            along = places[np.argmax(last - first)]
            lower = along < 0.5 * (along.min() + along.max())
            found = np.empty(len(along))
            for part in (lower, ~lower):
                found[part] = self._interpolated(places[:, part], strain, present)
            return found
        nodes = list(zip(first.tolist(), last.tolist(), strict=True))
        log_densities = self._log_densities(nodes, strain, present)
        return ndimage.map_coordinates(log_densities, places - first[:, None], order=1)

    def _log_densities(
        self, nodes: list[tuple[int, int]], strain: np.ndarray, present: np.ndarray
    ) -> np.ndarray:
        """Log-densities at ``nodes``, a range of each axis."""
        pairs = self._pairs_near(*nodes[0])
        exponents = self._exponents(self._strain[pairs], strain, present)
        log_scale = float(exponents.max(initial=-1e300)) - _LOG_LARGEST
        weights = np.exp(np.maximum(exponents - log_scale, _LOG_SMALLEST))
        log_scale += float(self._log_constants[present].sum())
        log_floor = math.log(self._floor) + self.background.log_density(strain, present)
        largest = max(log_scale, log_floor)
        sums = self._at_nodes(self._spread_some(pairs, weights), nodes) * math.exp(log_scale - largest)
        sums += max(math.exp(log_floor - largest), np.finfo(np.float64).tiny)
        return np.log(sums) + largest - self._log_density[tuple(slice(*own) for own in nodes)]

    def _pairs_near(self, first: int, last: int) -> slice:
        """The pairs within reach of the nodes from ``first`` until ``last`` on the axis of their order."""
        if self._wraps[0]:
            return slice(0, len(self._strain))
        low, high = self._axes[0].nodes(first, last)[[0, -1]]
        return slice(*np.searchsorted(self._first_axis, [low - _REACH, high + _REACH]).tolist())

    def _exponents(self, pairs: np.ndarray, strain: np.ndarray, present: np.ndarray) -> np.ndarray:
        """-||z - z_n||^2 / 2 in kernel widths, (n,), of the scaled strains (n, C) of ``pairs``."""
        strain = strain / self._strain_std
        if not present.all():
            used = self._layout.expand(present)
            strain, pairs = strain[used], pairs[:, used]
        return np.asarray(-0.5 * cdist(strain[None], pairs, "sqeuclidean")[0])

    def _spread_some(self, pairs: slice, weights: np.ndarray) -> np.ndarray:
        """The weights (n,) of ``pairs`` on the nodes of pairs."""
        spread = self._spread
        if len(weights) < spread.shape[1]:  # a view, which is faster than slicing the matrix
            own = slice(*spread.indptr[[pairs.start, pairs.stop]].tolist())
            arrays = spread.data[own], spread.indices[own], spread.indptr[: len(weights) + 1]
            spread = sparse.csc_array(arrays, shape=(spread.shape[0], len(weights)))
        return np.asarray(spread @ weights.astype(np.float32))

    def _at_nodes(self, spread: np.ndarray, nodes: list[tuple[int, int]]) -> np.ndarray:
        """Sums of weights that were ``spread`` times the position kernel, float64, at ``nodes``."""
        sums = spread
        for axis, (first, last) in zip(self._axes, nodes, strict=True):
            near, kernel = axis.kernel(first, last)
            # The axis goes last, so that after all of them the order is restored.
            sums = (kernel @ sums.reshape(axis.pair_count, -1)[near]).T
        return sums.reshape([last - first for first, last in nodes]).astype(np.float64)


class _LatticeAxis:
    """Nodes of one axis, in kernel widths: those on which pairs are spread, and those with log-likelihoods.

    A pair is spread on the three nodes around it by a quadratic B-spline. Wherever the pair lies between the
    nodes, that widens the kernel by a variance of h^2 / 4, with h their spacing; the kernel is narrowed by as
    much.

    Parameters
    ----------
    along : (N,) coordinates of the training pairs
    turn : period of the axis; infinite if it is not a full turn

    Attributes
    ----------
    pair_count, count : numbers of the two kinds of nodes
    """

    def __init__(self, along: np.ndarray, turn: float) -> None:
        self._turn = turn
        if math.isfinite(turn):
            self.pair_count = max(math.ceil(_PAIR_NODES_PER_STD * turn), 3)
            self.count = math.ceil(_NODES_PER_STD * turn) + 1  # the last node is the first one again
            self._low = self._pair_low = -0.5 * turn
            self._spacing, self._pair_spacing = turn / (self.count - 1), turn / self.pair_count
        else:
            low, high = float(along.min()), float(along.max())
            self._spacing, self._pair_spacing = 1.0 / _NODES_PER_STD, 1.0 / _PAIR_NODES_PER_STD
            self._low, self._pair_low = low - _MARGIN, low - self._pair_spacing
            self.pair_count = int((high - low) / self._pair_spacing) + 4
            self.count = math.ceil((high - low + 2.0 * _MARGIN) / self._spacing) + 1
        self._variance = 1.0 - self._pair_spacing**2 / 4.0

    def spread(self, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Indices of the nodes around pairs (N,), and the weight of the pair on each: (N, 3)."""
        places = (along - self._pair_low) / self._pair_spacing
        nearest = np.rint(places)
        offset = places - nearest
        weights = np.stack([0.5 * (0.5 - offset) ** 2, 0.75 - offset**2, 0.5 * (0.5 + offset) ** 2], axis=1)
        nodes = (nearest.astype(np.int32)[:, None] + np.arange(-1, 2, dtype=np.int32)) % self.pair_count
        return nodes, (weights / math.sqrt(self._variance)).astype(np.float32)

    def places(self, along: np.ndarray) -> np.ndarray:
        """Coordinates (P,) in nodes from the first one; beyond the outermost nodes, theirs."""
        return np.clip((along - self._low) / self._spacing, 0.0, self.count - 1.0)

    def nodes(self, first: int, last: int) -> np.ndarray:
        """Coordinates of the nodes from ``first`` until ``last``."""
        return self._low + self._spacing * np.arange(first, last)

    def kernel(self, first: int, last: int) -> tuple[slice, np.ndarray]:
        """The nodes of pairs within reach of some nodes, and the kernel between both, float32."""
        nodes, near = self.nodes(first, last), slice(0, self.pair_count)
        if math.isinf(self._turn):
            reach = np.array([nodes[0] - _REACH, nodes[-1] + _REACH + self._pair_spacing]) - self._pair_low
            near = slice(*np.clip(reach / self._pair_spacing, 0, self.pair_count).astype(int).tolist())
        apart = nodes[:, None] - (self._pair_low + self._pair_spacing * np.arange(near.start, near.stop))
        if math.isfinite(self._turn):
            apart -= self._turn * np.rint(apart / self._turn)
        kernel = apart.astype(np.float32)
        kernel *= kernel
        kernel *= np.float32(-0.5 / self._variance)
        return near, np.exp(kernel, out=kernel)
