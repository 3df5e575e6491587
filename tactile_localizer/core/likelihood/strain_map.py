"""Tables of the expected strain and its variance on a lattice, computed once per scan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.geometry.motion import levers
from tactile_localizer.core.likelihood.base import flatten_axes
from tactile_localizer.core.likelihood.drift import innovations
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.core.likelihood.noise_model import (
    BEFORE,
    NoiseModel,
    Residuals,
    WhitenedScan,
    held_out,
)
from tactile_localizer.core.likelihood.student_t import log_density
from tactile_localizer.core.scan.tracks import PITCH, Expectation, Track, expectation
from tactile_localizer.scene import Scene

NODES_PER_CELL = 2
"""Nodes of the lattice per cell and axis; on three axes one, for memory."""
MOST_CELLS_IN_SPACE = 25_000
"""Largest number of cells on three axes, with which a measurement update from a uniform prior takes less than
10 ms: 50 mm x 50 mm x 20 degrees at 0.7 mm and 2 degrees."""
_NODES_AT_ONCE = 2**15
"""Nodes computed in double precision at a time."""
_LONGEST_CORRELATION = 0.03
"""Largest lag of the residual's autocorrelation, m."""


_FACTORS = {
    "visit": (0.7, 0.1, 10.0),
    "interpolation": (0.4, 0.01, 10.0),
    "signal": (0.01, 1e-4, 1.0),
}
"""First value and bounds of each fitted factor of :class:`VarianceModel`."""


@dataclass(frozen=True)
class VarianceModel:
    """Variance of a new visit about its expectation, in units of the whitened noise.

    Parameters
    ----------
    visit : factor of the noise of the visit and of the mean
    signal : factor of the squared signal, because visits differ more where the signal is stronger; zero if
        there is no featureless strain relative to which the signal is defined
    interpolation : factor of :attr:`.Expectation.interpolation_error`
    summed_correlation : m of travel between independent residuals
    """

    visit: float = 1.0
    signal: float = 0.0
    interpolation: float = 0.5
    summed_correlation: float = 0.003

    def variance(self, expected: Expectation, layout: ChannelLayout) -> np.ndarray:
        """Variance of a new visit, (M, K, F)."""
        counts = np.array(layout.counts)
        signal = layout.sum(expected.mean**2) / counts
        error = layout.sum(expected.interpolation_error) / counts
        # Where both tracks are exactly featureless, their mean has no noise: no place is preferred there.
        felt = signal + error > 0.0
        visit = self.visit * (1.0 + expected.noise[..., None] * felt)
        return visit + self.signal * signal + self.interpolation * error


class StrainMap(NamedTuple):
    """Tables on a lattice of M nodes that covers the scene, with K components each.

    Parameters
    ----------
    origin, step, shape : (d,) first node, distance of the nodes and their number along each axis
    mean : (M, K, C) float32, whitened strain
    variance : (M, K, F) float32, variance of a new visit about it
    log_prior : (M, K) float32, of the components
    featureless_variance : of a visit to featureless material; ``None`` where the material is felt everywhere
    turning : (d, C) change of the whitened strain of featureless material per m (rad) of each axis: zero but
        for yaw; not in ``mean``
    """

    origin: np.ndarray
    step: np.ndarray
    shape: tuple[int, ...]
    mean: np.ndarray
    variance: np.ndarray
    log_prior: np.ndarray
    featureless_variance: float | None
    turning: np.ndarray

    def nearest(self, states: np.ndarray) -> np.ndarray:
        """Index (P,) of the node nearest to each of ``states`` (P, d), which may be outside the lattice."""
        index = np.zeros(len(states))
        for axis, count in enumerate(self.shape):
            along = np.rint((states[:, axis] - self.origin[axis]) / self.step[axis])
            np.minimum(along, count - 1.0, out=along)
            np.maximum(along, 0.0, out=along)
            index *= count
            index += along
        return index.astype(np.intp)


def cell_size(scene: Scene, spacing: float, lines: float) -> np.ndarray:
    """Size (d,) of a filter's cells: ``lines`` line spacings, on one axis a pitch.

    On three axes cells are enlarged to limit their number to :data:`MOST_CELLS_IN_SPACE`.

    Raises
    ------
    SceneError
        There would be too many cells for the memory.
    """
    length = PITCH if scene.dimension == 1 else max(lines * spacing, PITCH)
    sizes = length / levers(scene)
    extent = scene.extent
    if scene.dimension == 3:
        sizes *= max(1.0, float(np.prod(extent / sizes)) / MOST_CELLS_IN_SPACE) ** (1.0 / 3.0)
    scene.cells(sizes)
    return np.minimum(sizes, extent)


def fit_variance(estimate: WhitenedScan, scene: Scene) -> VarianceModel:
    """Maximum-likelihood variance model of each sweep of the scan given the others."""
    # An import of half a second, not needed for a calibrated scan.
    from scipy.optimize import minimize
    from scipy.special import logsumexp

    if len(estimate.tracks) < 2:
        return VarianceModel()
    layout = estimate.model.layout
    residuals = _residuals(estimate, scene)
    thinned = [residual.thinned() for residual in residuals]
    squared = np.concatenate([layout.sum(each.residual**2) for each in thinned])
    expected = Expectation(
        *(np.concatenate(parts) for parts in zip(*(e.expected for e in thinned), strict=True))
    )
    counts = np.array(layout.counts)
    factors = ["visit", "interpolation"]
    if estimate.material.has_level:
        factors.append("signal")
    start, *bounds = np.log([_FACTORS[factor] for factor in factors]).T

    def model(log_factors: np.ndarray) -> VarianceModel:
        return VarianceModel(**dict(zip(factors, np.exp(log_factors).tolist(), strict=True)))

    def cost(log_factors: np.ndarray) -> float:
        variance = model(log_factors).variance(expected, layout)
        density = log_density(squared, variance, counts)
        return -float(logsumexp(expected.log_prior[..., None] + density, axis=1).sum(axis=-1).mean())

    options = {"maxiter": 40 * len(factors)}
    found = minimize(cost, start, method="Nelder-Mead", bounds=np.transpose(bounds), options=options)
    fitted = model(found.x)
    scaled = [
        r.residual[:, 0] / np.sqrt(layout.expand(fitted.variance(r.expected, layout)[:, 0]))
        for r in residuals
    ]
    return replace(fitted, summed_correlation=summed_correlation(scaled, fitted.summed_correlation))


def _residuals(estimate: WhitenedScan, scene: Scene) -> list[Residuals]:
    """Residuals of held-out sweeps; innovations of them, where the material is felt everywhere."""
    material = estimate.material
    residuals = held_out(estimate.tracks, estimate.visits, scene, estimate.spacing, material.components)
    if material.has_level:
        return residuals
    found = []
    for each in residuals:
        left = innovations(each.residual[:, 0], material.memory, PITCH, robust=True)
        kept = slice(min(BEFORE, len(left) // 2), None)
        visit = Track(each.visit.positions[kept], each.visit.strain[kept])
        expected = Expectation(*(part[kept] for part in each.expected))
        found.append(Residuals(visit, left[kept, None], expected))
    return found


def build_map(
    tracks: Sequence[Track],
    scene: Scene,
    spacing: float,
    cell: np.ndarray,
    variance: VarianceModel,
    material: Material,
    model: NoiseModel,
    nodes_per_cell: int = NODES_PER_CELL,
) -> StrainMap:
    """Tables for a filter whose cells have the size ``cell`` (d,).

    Each place has as many components as the ``material`` says: the nearest pairs of tracks.
    """
    per_cell = 1 if scene.dimension == 3 else nodes_per_cell
    extent = scene.extent
    shape = tuple(int(count) for count in np.maximum(np.ceil(extent * per_cell / cell - 1e-9), 1))
    step = extent / np.array(shape)
    origin = scene.lower + 0.5 * step
    axes = [first + size * np.arange(count) for first, size, count in zip(origin, step, shape, strict=True)]
    places = flatten_axes(axes)
    tables: list[np.ndarray] = []
    for begin in range(0, len(places), _NODES_AT_ONCE):
        part = slice(begin, begin + _NODES_AT_ONCE)
        expected = expectation(tracks, scene, places[part], spacing, material.components)
        spread = variance.variance(expected, model.layout)
        found = (expected.mean, spread, expected.log_prior)
        if not tables:
            tables = [np.empty((len(places), *each.shape[1:]), dtype=np.float32) for each in found]
        for table, each in zip(tables, found, strict=True):
            table[part] = each
    mean, spread, prior = tables
    least = float(spread.min()) if material.has_level else None
    by_axis = np.outer([name == "yaw" for name in scene.axis_names], model.turning)
    return StrainMap(origin, step, shape, mean, spread, prior, least, by_axis)


def summed_correlation(series: Sequence[np.ndarray], otherwise: float) -> float:
    """Integrated autocorrelation, m, of series (n, C) along tracks; a default where nothing varies."""
    lags = round(_LONGEST_CORRELATION / PITCH)
    products, counts = np.zeros(lags), np.zeros(lags)
    for each in series:
        values = _bounded(each)
        for lag in range(min(lags, len(values) // 2)):
            products[lag] += float(np.sum(values[: len(values) - lag] * values[lag:]))
            counts[lag] += values[lag:].size
    if products[0] <= 0.0:
        return otherwise
    correlation = np.divide(products, counts, out=np.zeros(lags), where=counts > 0) / (
        products[0] / counts[0]
    )
    below = np.flatnonzero(correlation < 0.05)
    end = int(below[0]) if len(below) else lags
    return PITCH * (1.0 + 2.0 * float(correlation[1:end].sum()))


def _bounded(values: np.ndarray) -> np.ndarray:
    """Deviations (n, C) from the median of each channel, clipped at four robust standard deviations."""
    deviation = values - np.median(values, axis=0)
    width = 4.0 * 1.4826 * np.median(np.abs(deviation), axis=0)
    return np.clip(deviation, -width, width)
