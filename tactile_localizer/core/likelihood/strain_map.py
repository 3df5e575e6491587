"""Tables of the expected strain and its variance on a lattice, computed once per scan."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.geometry.lattice import flatten_axes
from tactile_localizer.core.geometry.motion import levers
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.core.likelihood.noise_model import WhitenedScan
from tactile_localizer.core.likelihood.student_t import log_density, mahalanobis, weight
from tactile_localizer.core.scan.interpolation import Expectation, interpolations, tiles
from tactile_localizer.core.scan.tracks import PITCH
from tactile_localizer.scene import Scene

NODES_PER_CELL = 2
"""Nodes of the lattice per cell and axis; on three axes one, for memory."""
MOST_CELLS_IN_SPACE = 25_000
"""Largest number of cells on three axes, with which a measurement update from a uniform prior takes less than
10 ms: 50 mm x 50 mm x 20 degrees at 1.3 mm and 1.2 degrees."""
_CELLS_PER_PITCH = 4
"""Cells on one axis per pitch of the tracks: there they cost little, and a quiet sensor resolves more."""
_MOST_POINTS = 200
"""Points of a held-out track, about, to which the variance model is fitted."""

_FIRST_SIGNAL, _FIRST_GAIN = 0.01, 0.03
"""First values of the factors of the signal, where there is a level from which it deviates."""
_LEAST_VISIT = 0.1
"""Least factor of the noise of a visit: that of a scan without any is its resolution."""
_MOST_ITERATIONS, _CONVERGED = 200, 1e-3
"""Iterations of a fit, and the relative change of its factors at which it ends."""


@dataclass(frozen=True)
class VarianceModel:
    """Variance of a new visit about its expectation, in units of the whitened noise.

    Parameters
    ----------
    visit : factor of the noise of the visit and of the mean
    signal : factor of the squared signal, because visits differ more where the signal is stronger; zero if
        there is no featureless strain relative to which the signal is defined
    interpolation : factor of :attr:`.Expectation.interpolation_error`
    gain : variance of the factor by which visits differ in the signal of a phalanx, as for another force;
        zero as ``signal``
    """

    visit: float = 1.0
    signal: float = 0.0
    interpolation: float = 0.5
    gain: float = 0.0

    def variance(self, expected: Expectation, layout: ChannelLayout) -> np.ndarray:
        """Variance of a new visit, (M, K, F), in the directions in which there is no signal."""
        return np.asarray(np.tensordot(self.factors, _terms(expected, layout), 1))

    @property
    def factors(self) -> np.ndarray:
        """Factors of the visit, the signal and the interpolation, (3,)."""
        return np.array([self.visit, self.signal, self.interpolation])


def _terms(expected: Expectation, layout: ChannelLayout) -> np.ndarray:
    """Variances (3, M, K, F) of which the factors are fitted: of the visit, the signal, the interpolation."""
    signal, error = layout.mean(expected.mean**2), layout.mean(expected.interpolation_error)
    # Where both tracks are exactly featureless, their mean has no noise: no place is preferred there.
    visit = 1.0 + expected.noise[..., None] * (signal + error > 0.0)
    return np.stack([visit, signal, error])


class StrainMap(NamedTuple):
    """Tables on a lattice of M nodes that covers the scene, with K components each.

    Parameters
    ----------
    origin, step, shape : (d,) first node, distance of the nodes and their number along each axis
    mean : (M, K, C) float32, whitened strain
    variance : (M, K, F) float32, variance of a new visit about it
    log_prior : (M, K) float32, of the components
    gain : variance of the factor by which visits differ in the signal of a phalanx
    turning : (d, C) change of the whitened strain of featureless material per m (rad) of each axis: zero but
        for yaw; not in ``mean``
    """

    origin: np.ndarray
    step: np.ndarray
    shape: tuple[int, ...]
    mean: np.ndarray
    variance: np.ndarray
    log_prior: np.ndarray
    gain: float
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


def cell_size(scene: Scene, spacing: float, lines: float, times: float = 1.0) -> np.ndarray:
    """Size (d,) of a filter's cells: ``lines`` line spacings, at least a pitch; on one axis a part of it.

    On more axes it is taken ``times`` so large. On three axes cells are enlarged to limit their number to
    :data:`MOST_CELLS_IN_SPACE`.

    Raises
    ------
    SceneError
        There would be too many cells for the memory.
    """
    one_axis = scene.dimension == 1
    length = PITCH / _CELLS_PER_PITCH if one_axis else times * max(lines * spacing, PITCH)
    sizes = length / levers(scene)
    extent = scene.extent
    if scene.dimension == 3:
        sizes *= max(1.0, float(np.prod(extent / sizes)) / MOST_CELLS_IN_SPACE) ** (1.0 / 3.0)
    scene.cells(sizes)
    return np.minimum(sizes, extent)


def fit_variance(scan: WhitenedScan) -> VarianceModel:
    """Maximum-likelihood variance model of each sweep of the scan given the others, by EM."""
    if scan.held_out is None:
        return VarianceModel()
    assert scan.strain is not None
    layout, material = scan.noise.layout, scan.material
    points, slices, interpolation = scan.held_out
    first = interpolation.best(1).expected(scan.signal)
    residuals = scan.strain[points] - first.mean[:, 0]
    for own in slices:
        residuals[own] = material.innovations(residuals[own], scan.tracks.pitch, robust=True)
    points = np.arange(len(residuals))
    thinned = np.concatenate([points[own][:: max(1, len(points[own]) // _MOST_POINTS)] for own in slices])
    expected = interpolation.at(thinned).expected(scan.signal)
    by_component = residuals[thinned, None] + first.mean[thinned] - expected.mean
    return _fitted(expected, by_component, layout, material)


def _fitted(
    expected: Expectation, residual: np.ndarray, layout: ChannelLayout, material: Material
) -> VarianceModel:
    """Factors under which residuals (M, K, C) are likeliest.

    The signal counts on a sheet, which has a level from which it deviates.

    EM averages over the component and the scale of the t-distribution; the maximum over each
    factor of a bound of what is left is in closed form (Zhou et al., 2019, square root left out). The first
    values count as one observation each, so that they stay where there is none.
    """
    sheet = float(material is Material.SHEET)
    counts = np.array([1.0, sheet, 1.0, sheet])
    first = np.append(VarianceModel(signal=_FIRST_SIGNAL).factors, _FIRST_GAIN)
    terms, widths, axes = _terms(expected, layout), layout.widths, ([1, 2, 3], [0, 1, 2])
    terms[1] *= sheet
    squared, energy = layout.sum(residual**2), sheet * layout.sum(expected.mean**2)
    product = sheet * layout.sum(residual * expected.mean)
    factors = first
    for _ in range(_MOST_ITERATIONS):
        variance, gain = np.tensordot(factors[:3], terms, 1), factors[3]
        total, projected = variance + gain * energy, gain * product**2
        length = mahalanobis(squared, variance, projected, total)
        log_weights = expected.log_prior[..., None] + log_density(length, variance, total, widths)
        weights = np.exp(log_weights - log_weights.max(axis=1, keepdims=True))
        weights /= weights.sum(axis=1, keepdims=True)
        # With S the scale matrix: r'S^-1 r, r'S^-2 r and the trace of S^-1; (m'S^-1 r)^2 and m'S^-1 m.
        even = (squared - projected * (2.0 - gain * energy / total) / total) / variance**2
        trace = (widths - gain * energy / total) / variance
        tails = weights * weight(length, widths)
        found = np.append(np.tensordot(terms, tails * even, axes), np.sum(tails * (product / total) ** 2))
        bound = np.append(np.tensordot(terms, weights * trace, axes), np.sum(weights * energy / total))
        ratio = (factors * found + first / np.maximum(factors, 1e-300)) / (factors * bound + 1.0)
        factors = np.maximum(factors * ratio, [_LEAST_VISIT, 0.0, 0.0, 0.0])
        if np.abs(ratio[factors > 0.0] - 1.0).max() < _CONVERGED:
            break
    return VarianceModel(*(counts * factors).tolist())


def build_maps(
    scan: WhitenedScan,
    variance: VarianceModel,
    scene: Scene,
    cell: np.ndarray,
    without: Sequence[np.ndarray],
) -> list[StrainMap]:
    """Tables for a filter whose cells have the size ``cell`` (d,), each without some of the tracks (S,) bool.

    Each place has as many components as pairs of tracks are near it.
    """
    per_cell = 1 if scene.dimension == 3 else NODES_PER_CELL
    extent = scene.extent
    shape = tuple(int(count) for count in np.maximum(np.ceil(extent * per_cell / cell - 1e-9), 1))
    step = extent / np.array(shape)
    origin = scene.lower + 0.5 * step
    axes = [first + size * np.arange(count) for first, size, count in zip(origin, step, shape, strict=True)]
    places = flatten_axes(axes)
    tables: list[list[np.ndarray]] = [[] for _ in without]
    for part in tiles(places * levers(scene)):
        each_without = interpolations(scan.tracks, places[part], scan.spacing, without)
        for own, interpolation in zip(tables, each_without, strict=True):
            expected = interpolation.expected(scan.signal)
            spread = variance.variance(expected, scan.noise.layout)
            found = (expected.mean, spread, expected.log_prior)
            if not own:
                own += [np.empty((len(places), *each.shape[1:]), dtype=np.float32) for each in found]
            for table, each in zip(own, found, strict=True):
                table[part] = each
    by_axis = np.outer([name == "yaw" for name in scene.axis_names], scan.noise.turning)
    return [
        StrainMap(origin, step, shape, mean, spread, prior, variance.gain, by_axis)
        for mean, spread, prior in tables
    ]
