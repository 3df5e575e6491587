"""What every place is expected to feel like, as tables on a lattice that are computed once per scan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize
from scipy.special import logsumexp

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.geometry.motion import YAW_LEVER
from tactile_localizer.core.likelihood.base import flatten_axes
from tactile_localizer.core.likelihood.noise_model import NoiseEstimate, held_out
from tactile_localizer.core.likelihood.student_t import log_density
from tactile_localizer.core.scan.tracks import (
    PITCH,
    Expectation,
    Track,
    expectation,
)
from tactile_localizer.scene import Scene

PAIRS = 3
"""Pairs of tracks that a place is interpolated from, the components of its mixture."""
_ABSENT = 0.01
"""Prior probability that a place does not feel as any pair of tracks says, but featureless."""
_NODES_PER_CELL = 2
"""Nodes of the lattice per cell and axis; on three axes one, for memory."""
_LONGEST_CORRELATION = 0.03
"""m; correlations of the residual are looked for up to here."""


@dataclass(frozen=True)
class VarianceModel:
    """Variance of a visit about its expectation, in units of the whitened noise, and its course.

    Parameters
    ----------
    visit : factor of the noise of the visit and of the mean
    doubt : factor of what interpolation leaves open (:attr:`.Expectation.doubt`)
    correlation_length : m over which the slow part of the residual decays to 1/e
    white_share : share of the residual's variance that is independent from one update to the next
    summed_correlation : m of travel that make one independent look at the residual
    """

    visit: float = 1.0
    doubt: float = 0.5
    correlation_length: float = 0.003
    white_share: float = 0.5
    summed_correlation: float = 0.003

    def variance(self, expected: Expectation, layout: ChannelLayout) -> np.ndarray:
        """Variance of a new visit, (M, K, F)."""
        doubt = layout.sum(expected.doubt) / np.array(layout.counts)
        return self.visit * (1.0 + expected.noise[..., None]) + self.doubt * doubt


class StrainMap(NamedTuple):
    """Tables on a lattice of M nodes that covers the scene, with K components each.

    Parameters
    ----------
    origin, step, shape : (d,) first node, distance of the nodes and their number along each axis
    mean : (M, K, C) float32, whitened strain
    variance : (M, K, F) float32, variance of a new visit about it
    log_prior : (M, K) float32
    """

    origin: np.ndarray
    step: np.ndarray
    shape: tuple[int, ...]
    mean: np.ndarray
    variance: np.ndarray
    log_prior: np.ndarray

    def nearest(self, states: np.ndarray) -> np.ndarray:
        """Index of the node nearest to each of ``states`` (P, d), (P,) int; those beyond are moved inside."""
        index = np.zeros(len(states), dtype=np.intp)
        for axis, count in enumerate(self.shape):
            along = np.rint((states[:, axis] - self.origin[axis]) / self.step[axis]).astype(np.intp)
            index = index * count + np.clip(along, 0, count - 1)
        return index


def cell_size(scene: Scene, spacing: float, lines: float) -> np.ndarray:
    """Size of a filter's cell on each axis, (d,): ``lines`` spacings of the tracks, on one axis a pitch."""
    length = PITCH if scene.dimension == 1 else max(lines * spacing, PITCH)
    sizes = np.array([length / YAW_LEVER if axis.name == "yaw" else length for axis in scene.axes])
    return np.minimum(sizes, scene.upper - scene.lower)


def fit_variance(estimate: NoiseEstimate, scene: Scene) -> VarianceModel:
    """The variance model under which each sweep of the scan is most likely, given the others."""
    if len(estimate.tracks) < 2:
        return VarianceModel()
    residuals = held_out(estimate.tracks, estimate.visits, scene, estimate.spacing, PAIRS)
    layout = scene.layout
    kept = [_thin(len(r.residual)) for r in residuals]
    squared = np.concatenate(
        [layout.sum(r.residual[rows] ** 2) for r, rows in zip(residuals, kept, strict=True)]
    )
    noise = np.concatenate([r.expected.noise[rows] for r, rows in zip(residuals, kept, strict=True)])
    prior = np.concatenate([r.expected.log_prior[rows] for r, rows in zip(residuals, kept, strict=True)])
    doubt = np.concatenate(
        [layout.sum(r.expected.doubt[rows]) for r, rows in zip(residuals, kept, strict=True)]
    )
    counts = np.array(layout.counts)

    def cost(log_factors: np.ndarray) -> float:
        visit, open_ = np.exp(log_factors)
        variance = visit * (1.0 + noise[..., None]) + open_ * doubt / counts
        density = sum(
            log_density(squared[..., f], variance[..., f], int(count)) for f, count in enumerate(counts)
        )
        return -float(logsumexp(prior + density, axis=1).mean())

    bounds = [(np.log(0.1), np.log(10.0)), (np.log(0.01), np.log(10.0))]
    found = minimize(cost, np.log([0.7, 0.4]), method="Nelder-Mead", bounds=bounds, options={"maxiter": 80})
    visit, open_ = np.exp(found.x)
    fitted = VarianceModel(float(visit), float(open_))
    scaled = [
        r.residual[:, 0] / np.sqrt(layout.expand(fitted.variance(r.expected, layout)[:, 0]))
        for r in residuals
    ]
    return VarianceModel(float(visit), float(open_), *_correlation(scaled))


def build_map(
    tracks: Sequence[Track],
    scene: Scene,
    spacing: float,
    cell: np.ndarray,
    variance: VarianceModel,
    nodes_per_cell: int = _NODES_PER_CELL,
) -> StrainMap:
    """Tables for a filter whose cells have the size ``cell`` (d,)."""
    per_cell = 1 if scene.dimension == 3 else nodes_per_cell
    extent = scene.upper - scene.lower
    shape = tuple(int(count) for count in np.maximum(np.ceil(extent * per_cell / cell - 1e-9), 1))
    step = extent / np.array(shape)
    origin = scene.lower + 0.5 * step
    axes = [first + size * np.arange(count) for first, size, count in zip(origin, step, shape, strict=True)]
    expected = expectation(tracks, scene, flatten_axes(axes), spacing, PAIRS)
    mean, spread, prior = expected.mean, variance.variance(expected, scene.layout), expected.log_prior
    if scene.dimension > 1:
        mean = np.concatenate([mean, np.zeros_like(mean[:, :1])], axis=1)
        least = np.full_like(spread[:, :1], variance.visit)
        spread = np.concatenate([spread, least], axis=1)
        absent = np.full_like(prior[:, :1], np.log(_ABSENT))
        prior = np.concatenate([prior + np.log1p(-_ABSENT), absent], axis=1)
    tables = (np.ascontiguousarray(table, dtype=np.float32) for table in (mean, spread, prior))
    return StrainMap(origin, step, shape, *tables)


def _thin(count: int, most: int = 400) -> np.ndarray:
    return np.arange(0, count, max(1, count // most))


def _correlation(scaled: Sequence[np.ndarray]) -> tuple[float, float, float]:
    """Correlation length, white share and summed correlation length of residuals (n, C) along the tracks."""
    lags = np.arange(1, round(_LONGEST_CORRELATION / PITCH))
    products, counts = np.zeros(len(lags) + 1), np.zeros(len(lags) + 1)
    for residual in scaled:
        bounded = np.clip(residual - np.median(residual, axis=0), -4.0, 4.0)
        for lag in range(min(len(lags) + 1, len(bounded) // 2)):
            products[lag] += float(np.sum(bounded[: len(bounded) - lag] * bounded[lag:]))
            counts[lag] += bounded[lag:].size
    if products[0] <= 0.0:
        return 0.003, 0.5, 0.003
    correlation = np.divide(products, counts, out=np.zeros_like(products), where=counts > 0)
    correlation = correlation[1:] / correlation[0]
    best = (np.inf, 0.003, 1.0)
    for length in (0.001, 0.0015, 0.002, 0.003, 0.004, 0.006, 0.008, 0.012):
        decay = np.exp(-lags * PITCH / length)
        slow = float(np.clip(correlation @ decay / (decay @ decay), 0.0, 0.9))
        error = float(np.sum((correlation - slow * decay) ** 2))
        if error < best[0]:
            best = (error, length, 1.0 - slow)
    below = np.flatnonzero(correlation < 0.05)
    end = int(below[0]) if len(below) else len(correlation)
    return best[1], best[2], PITCH * (1.0 + 2.0 * float(correlation[:end].sum()))
