"""Kernel density of the strain given the position, at the nodes of a lattice (paper, Eq. 4).

A sparse matrix, built once, spreads the training pairs on the nodes around them. A measurement takes one
weight per pair, a Gaussian filter of the lattice, and a cubic spline through the log-likelihoods.
"""

import math

import numpy as np
from scipy import ndimage, sparse
from scipy.spatial.distance import cdist

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.geometry.angles import wrap_angle
from tactile_localizer.errors import ParameterError
from tactile_localizer.paper.background import FLOOR, Background
from tactile_localizer.paper.lattice_kernel import LatticeKernel

MAX_NODES = 2**23
"""Largest number of nodes; a measurement update then takes a second or two."""
_NODES_PER_STD = 4
"""Nodes per kernel width: log-likelihoods are at most 0.05 nats off, down to 5 nats below the peak."""
_MARGIN = 5.0
"""Kernel widths around the pairs that have nodes; farther away the background is all that is left."""


class KernelDensity:
    """Kernel density of the strain given the position, with the background as its floor.

    .. math:: p(z | x) = (S(x, z) + a\\, b(z)) / (D(x) + a)

    where S is the sum over pairs of position kernel times strain kernel, D the sum of the position kernel
    alone and b the :class:`.Background`. ``a`` is :data:`.FLOOR` times the D of an evenly spread scan, so
    that the background alone remains where nothing was scanned.

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
        self._strain_std, self._strain = strain_std, strain / strain_std
        self._wraps, self._layout = wraps, layout
        self._log_constants = -0.5 * math.log(2.0 * math.pi) * layout.widths - layout.sum(np.log(strain_std))
        # On a full turn the kernel is a wrapped normal distribution, uniform once it is as wide as the turn.
        position_std = np.where(wraps, np.minimum(position_std, 2.0 * math.pi), position_std)
        margin = _MARGIN * position_std
        self._low = np.where(wraps, -math.pi, positions.min(axis=0) - margin)
        extent = np.where(wraps, math.pi, positions.max(axis=0) + margin) - self._low
        intervals = np.ceil(_NODES_PER_STD * extent / position_std)
        if np.prod(intervals) > MAX_NODES:
            raise ParameterError(
                f"position_std {position_std}: expected at most {MAX_NODES:,} nodes for the {len(strain):,} "
                f"pairs of the scan, got {np.prod(intervals):.3g}; use wider kernels (is the scan in mm?)"
            )
        self._spacing = extent / intervals
        self._shape = tuple((intervals + ~wraps).astype(int))  # the last node of a full turn is the first one
        per_std = position_std / self._spacing
        # A pair that is spread by a quadratic B-spline widens the kernel by a variance of 1/4.
        sigma = np.sqrt(per_std**2 - 0.25)
        self._kernels = [LatticeKernel(*axis) for axis in zip(sigma, self._shape, wraps, strict=True)]
        self._spread = self._spreading(positions)
        kernel = math.sqrt(2.0 * math.pi) * per_std
        typical = len(strain) / float(np.prod(np.maximum(np.ptp(positions, axis=0) / self._spacing, kernel)))
        self._floor = FLOOR * typical
        scanned = self._at_nodes(np.ones(len(strain))) if conditional else np.full(self._shape, typical)
        self._log_density = np.log(scanned + self._floor)

    def _places(self, positions: np.ndarray) -> np.ndarray:
        """Coordinates (d, P) in nodes from the first one; beyond the outermost nodes, theirs."""
        positions = np.where(self._wraps, wrap_angle(positions), positions)
        last = np.where(self._wraps, np.inf, np.array(self._shape) - 1.0)
        return np.asarray(np.clip((positions - self._low) / self._spacing, 0.0, last).T)

    def _spreading(self, positions: np.ndarray) -> sparse.csc_array:
        """Sparse matrix (nodes, pairs) that spreads a pair on the three nodes around it along each axis."""
        rows, taps = np.zeros((len(positions), 1), dtype=np.int64), np.ones((len(positions), 1))
        for along, count in zip(self._places(positions), self._shape, strict=True):
            nearest = np.rint(along)
            offset = along - nearest
            weights = np.stack(
                [0.5 * (0.5 - offset) ** 2, 0.75 - offset**2, 0.5 * (0.5 + offset) ** 2], axis=1
            )
            nodes = (nearest.astype(int)[:, None] + np.arange(-1, 2)) % count
            rows = (rows[:, :, None] * count + nodes[:, None, :]).reshape(len(positions), -1)
            taps = (taps[:, :, None] * weights[:, None, :]).reshape(len(positions), -1)
        starts = np.arange(0, rows.size + 1, rows.shape[1])
        return sparse.csc_array(
            (taps.ravel(), rows.ravel(), starts), shape=(math.prod(self._shape), len(positions))
        )

    def _at_nodes(self, weights: np.ndarray) -> np.ndarray:
        """Sums over the pairs of their ``weights`` (N,) times the position kernel, at all nodes."""
        sums = (self._spread @ weights).reshape(self._shape)
        for kernel in self._kernels:  # each takes the first axis and leaves it as the last
            sums = kernel.filter(sums)
        return sums

    def log_density(self, states: np.ndarray, strain: np.ndarray, present: np.ndarray) -> np.ndarray:
        """Log-density (P,) of a strain (C,) of the phalanges ``present`` (F,) at states (P, d)."""
        pairs, scaled = self._strain, strain / self._strain_std
        if not present.all():
            used = self._layout.expand(present)
            scaled, pairs = scaled[used], pairs[:, used]
        exponents = -0.5 * cdist(scaled[None], pairs, "sqeuclidean")[0]
        log_scale = float(exponents.max())
        sums = self._at_nodes(np.exp(exponents - log_scale))
        log_scale += float(self._log_constants[present].sum())
        log_floor = math.log(self._floor) + self.background.log_density(strain, present)
        # The logarithm of the sum of both, relative to the larger one.
        peak = max(log_scale, log_floor)
        sums *= math.exp(log_scale - peak)
        sums += max(math.exp(log_floor - peak), np.finfo(np.float64).tiny)
        log_density = np.log(sums) + peak - self._log_density
        # The ends of an axis that is not a full turn are alike: there the background is left.
        places = self._places(states)
        return np.asarray(ndimage.map_coordinates(log_density, places, order=3, mode="grid-wrap"))
