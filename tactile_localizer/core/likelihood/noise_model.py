"""Noise of one visit to a place, estimated from the differences between the sweeps of a scan.

The map, the alternatives to it and the level of a sweep all use this noise model.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.geometry.phalanges import phalanges_on_feature
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.core.likelihood.student_t import scatter, weight
from tactile_localizer.core.likelihood.white_noise import WhiteNoise, white_noise
from tactile_localizer.core.scan.interpolation import HeldOut, hold_out
from tactile_localizer.core.scan.lines import line_spacing
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.tracks import PITCH, Tracks
from tactile_localizer.scene import Scene

MOST_DIRECTIONS = 8
"""Whitened directions of a phalanx: as many as the gauges of the load cells on which all else was tried."""
_DIAGONAL_LOADING = 0.05
"""Fraction of each channel's variance that is added to the diagonal of the covariance."""
_FEATURELESS_STRETCH = 0.2
"""Length of the stretch that varies least, from which the featureless strain of a sweep is taken, as a
fraction of the sweep."""
_CORRELATED = 0.002
"""m within which deviations are alike: their energy is averaged over it. By judgement."""


@dataclass(frozen=True)
class NoiseModel:
    """Linear transform to whitened strains, in which the noise of each phalanx has unit covariance.

    Of a phalanx with more than :data:`MOST_DIRECTIONS` channels they are the directions in which the scan
    differs most. So W directions are left of C channels.

    Parameters
    ----------
    layout : whitened directions by phalanx
    centre : (C,) V, subtracted from every strain
    whitening : (W, C); ``whitening @ (strain - centre)`` are whitened strains
    inverse : (C, W) V, of whitened strains
    variance : (C,) V^2, of a visit in raw channels
    log_volume : (F,) logarithms of the volumes of its blocks, for densities over strains in volts
    level_variance : (W,) whitened variance of the level of a new sweep; infinite: it is unknown
    turning : (W,) change of the whitened featureless strain per rad of yaw: friction turns with the hand
    white : white noise of the scan's channels
    """

    layout: ChannelLayout
    centre: np.ndarray
    whitening: np.ndarray
    inverse: np.ndarray
    variance: np.ndarray
    log_volume: np.ndarray
    level_variance: np.ndarray
    turning: np.ndarray
    white: WhiteNoise

    def with_excess(self, excess: np.ndarray) -> np.ndarray:
        """Covariance (W, W) of whitened strains of which the raw channels have an ``excess`` (C, C), V^2."""
        return np.asarray(np.eye(self.layout.size) + self.whitening @ excess @ self.whitening.T)

    def whitened(self, strain: np.ndarray) -> np.ndarray:
        """Strains (..., C), V, in whitened coordinates."""
        return (strain - self.centre) @ self.whitening.T


class WhitenedScan(NamedTuple):
    """A scan in the coordinates in which the noise of a visit is white.

    Parameters
    ----------
    tracks : its sweeps, with strains as they were recorded
    spacing : of their lines, m
    held_out : tracks interpolated between the others; ``None`` of a single sweep
    material : kind of the material
    noise : the noise model
    levels : (S, C) V, by which each track's strains are moved, but for what turns with yaw; zero where no
        level is known
    strain : (n, W) of the tracks' points, whitened, without the levels; ``None``: not kept
    signal : (n, W) its reproducible part: exactly zero where nothing is reproducible
    """

    tracks: Tracks
    spacing: float
    held_out: HeldOut | None
    material: Material
    noise: NoiseModel
    levels: np.ndarray
    strain: np.ndarray | None
    signal: np.ndarray


class Visits(NamedTuple):
    """The sweeps of a scan side by side, before anything is assumed of the kind of the material.

    Parameters
    ----------
    tracks, spacing, held_out : as in :class:`WhitenedScan`
    white : white noise of its channels
    resolution : (C,) V, of its channels
    directions : (W, C) of the strain, in which the sweeps vary most
    back : (C, W) from these to the channels
    layout : directions by phalanx
    """

    tracks: Tracks
    spacing: float
    held_out: HeldOut | None
    white: WhiteNoise
    resolution: np.ndarray
    directions: np.ndarray
    back: np.ndarray
    layout: ChannelLayout

    @classmethod
    def of(cls, scan: Scan, scene: Scene) -> Visits:
        """Those of a scan.

        Raises
        ------
        SceneError
            The scene names an axis or a phalanx that the scan does not have.
        """
        tracks = Tracks.of(scan, scene)
        spacing = line_spacing(tracks)
        held_out = hold_out(tracks, spacing) if len(tracks) > 1 else None
        white, resolution = white_noise(scan, scene), _resolution(scan.strain_on(scene))
        directions = _directions(tracks, np.hypot(np.sqrt(white.variance[0]), resolution))
        return cls(tracks, spacing, held_out, white, resolution, *directions)


def _directions(tracks: Tracks, unit: np.ndarray) -> tuple[np.ndarray, np.ndarray, ChannelLayout]:
    """Directions (W, C) of the strain in which the sweeps vary most, back (C, W), and how many by phalanx.

    They are orthogonal in the ``unit`` (C,), V, of each channel.
    """
    all_channels = tracks.scene.layout
    layout = ChannelLayout(tuple(min(count, MOST_DIRECTIONS) for count in all_channels.counts))
    directions, back = np.zeros((2, layout.size, all_channels.size))
    for of, own in zip(layout.slices, all_channels.slices, strict=True):
        felt = tracks.strain[:, own]
        if felt.shape[1] <= MOST_DIRECTIONS:
            directions[of, own] = back[of, own] = np.eye(felt.shape[1])
            continue
        felt = np.concatenate([felt[each] - np.median(felt[each], axis=0) for each in tracks.slices])
        felt /= unit[own]
        found = np.linalg.eigh(felt.T @ felt)[1][:, : -MOST_DIRECTIONS - 1 : -1].T
        directions[of, own], back[of, own] = found / unit[own], found * unit[own]
    return directions, back.T, layout


def whiten(visits: Visits, material: Material) -> WhitenedScan:
    """Estimate the noise of one visit from how the sweeps of a scan of a ``material`` differ."""
    tracks, spacing, held_out, white, resolution, directions, back, layout = visits
    number, pitch, sheet = tracks.number, tracks.pitch, material is Material.SHEET
    felt, resolution = tracks.strain @ directions.T, np.sqrt(np.square(directions) @ resolution**2)
    middle = np.array([np.median(felt[own], axis=0) for own in tracks.slices])
    differences = _differences(felt - middle[number], held_out, spacing, Material.SHEET, pitch)
    first = _whitening(differences, resolution, layout, Material.SHEET)
    featureless = np.array(
        [_featureless_strain(tracks.strain[own], felt[own] @ first.T) for own in tracks.slices]
    )
    # The less of a sweep is featureless, the less is known of its level.
    turning = _turning(featureless, tracks)
    level = featureless - np.outer(_yaws(tracks), turning)
    centre = level.mean(axis=0)
    moved = featureless[number] if sheet else centre
    strain = (tracks.strain - moved) @ directions.T
    differences = _differences(strain, held_out, spacing, material, pitch)
    square = _whitening(differences, resolution, layout, material)
    whitening, inverse = square @ directions, back @ np.linalg.inv(square)
    left_out = np.eye(len(centre)) - inverse @ whitening
    noise = NoiseModel(
        layout,
        centre,
        whitening,
        inverse,
        np.square(inverse).sum(axis=1) + np.square(left_out) @ white.variance[0],
        np.array([np.log(np.diag(square)[own]).sum() for own in layout.slices]),
        material.session_ratio * _level_variance(level @ whitening.T, layout),
        whitening @ turning if sheet else np.zeros(layout.size),
        white,
    )
    strain = strain @ square.T
    kept = (
        _kept(strain, layout, tracks) if sheet else _reproducible_fraction(strain, held_out, material, pitch)
    )
    levels = level - centre if sheet else np.zeros_like(level)
    return WhitenedScan(tracks, spacing, held_out, material, noise, levels, strain, kept * strain)


def _differences(
    strain: np.ndarray, held_out: HeldOut | None, spacing: float, material: Material, pitch: float
) -> np.ndarray:
    """Differences (m, C) of tracks with ``strain`` (n, C) from others, scaled to the variance of a visit."""
    if held_out is None:  # the roughness along the sweep is the only measure of noise
        roughness = np.diff(strain, n=2, axis=0) / np.sqrt(6.0)
        return roughness if len(roughness) else np.zeros_like(strain)
    expected = held_out.interpolation.best(1).expected(strain)
    differences = (strain[held_out.points] - expected.mean[:, 0]) / np.sqrt(1.0 + expected.noise)
    near, found = expected.distance <= 2.0 * max(spacing, 2.0 * PITCH), []
    for own in held_out.slices:
        inside, difference = near[own] | ~near[own].any(), differences[own]
        found.append(material.innovations(difference, pitch, robust=True)[inside])
    return np.concatenate(found)


def _whitening(
    differences: np.ndarray, resolution: np.ndarray, layout: ChannelLayout, material: Material
) -> np.ndarray:
    """Inverse Cholesky factor of the robust scatter of differences (m, C)."""
    # Scaled per channel, so that the result does not depend on the unit.
    unit = np.maximum(np.sqrt(np.mean(differences**2, axis=0)), resolution)
    scaled, separate = differences / unit, np.zeros((layout.size,) * 2)
    for own in layout.slices:
        separate[own, own] = scatter(scaled[:, own])
    matrix = separate if material is Material.SHEET else scatter(scaled)
    matrix += np.diag(_DIAGONAL_LOADING * matrix.diagonal() + (resolution / unit) ** 2 / 12.0)
    return np.linalg.inv(np.linalg.cholesky(matrix)) / unit


def _resolution(strain: np.ndarray) -> np.ndarray:
    """Quantization step of each channel, (C,), the smallest difference between its values."""
    sample = np.sort(strain[:: max(1, len(strain) // 20_000)], axis=0)
    steps = np.diff(sample, axis=0)
    smallest = np.where(steps > 0.0, steps, np.inf).min(axis=0, initial=np.inf)
    low, high = strain.min(axis=0), strain.max(axis=0)
    spread = high - low  # an offset does not make a channel coarser
    floor = 1e-9 * np.where(spread > 0.0, spread, np.maximum(-low, high)) + 1e-30
    return np.maximum(np.where(np.isfinite(smallest), smallest, 0.0), floor)


def _featureless_strain(strain: np.ndarray, whitened: np.ndarray) -> np.ndarray:
    """Mean (C,) of a sweep's ``strain`` (n, C) over the stretch that, ``whitened`` (n, W), varies least."""
    width = max(3, round(_FEATURELESS_STRETCH * len(strain)))
    middle = np.median(strain, axis=0)
    if len(strain) <= width:
        return np.asarray(middle)
    # In squares of a large offset the signal would be lost.
    whitened = whitened - np.median(whitened, axis=0)
    deviation = np.vstack([np.zeros(whitened.shape[1]), whitened])
    sums, squares = np.cumsum(deviation, axis=0), np.cumsum(deviation**2, axis=0)
    variance = (squares[width:] - squares[:-width]) / width - ((sums[width:] - sums[:-width]) / width) ** 2
    start = int(variance.sum(axis=1).argmin())
    return np.asarray(middle + (strain[start : start + width] - middle).mean(axis=0))


def _yaws(tracks: Tracks) -> np.ndarray:
    """Mean yaw (S,) of each track, rad; zero where the scene does not name it or it is a full turn."""
    names = tracks.scene.axis_names
    if "yaw" not in names or tracks.scene.wraps[names.index("yaw")]:
        return np.zeros(len(tracks))
    return np.bincount(tracks.number, tracks.positions[:, names.index("yaw")]) / tracks.counts


def _turning(level: np.ndarray, tracks: Tracks) -> np.ndarray:
    """Change of the tracks' featureless strains (S, C) per rad of yaw, by least squares: (C,) V/rad."""
    yaw = _yaws(tracks)
    away = yaw - yaw.mean()
    spread = float(away @ away)
    return np.asarray(away @ level / spread) if spread > 0.0 else np.zeros(level.shape[1])


def _level_variance(levels: np.ndarray, layout: ChannelLayout) -> np.ndarray:
    """Variance (C,) of the sweeps' levels (S, C), averaged with its mean over the phalanx (few sweeps)."""
    variance = levels.var(axis=0, ddof=min(1, len(levels) - 1)) + np.finfo(np.float64).tiny
    return np.asarray(0.5 * (variance + layout.expand(layout.mean(variance))))


def _reproducible_fraction(
    strain: np.ndarray, held_out: HeldOut | None, material: Material, pitch: float
) -> float:
    """Slope, from 0 to 1, of the innovations of tracks with ``strain`` (n, C) on those of the others.

    The less of a map is signal, the less of it is expected of a new visit; 1 of a single track.
    """
    if held_out is None:
        return 1.0
    expected = held_out.interpolation.best(1).expected(strain).mean[:, 0]
    product = energy = 0.0
    for own in held_out.slices:
        felt, there = (
            _bounded(material.innovations(each[own], pitch, robust=True))
            for each in (strain[held_out.points], expected)
        )
        product += float(np.sum(felt * there))
        energy += float(np.sum(there**2))
    return min(max(product / energy, 0.0), 1.0) if energy > 0.0 else 1.0


def _bounded(values: np.ndarray) -> np.ndarray:
    """Vectors (n, C), bounded as by the weights of the t-distribution: an absurd one hardly counts."""
    squared, channels = np.square(values).sum(axis=1, keepdims=True), values.shape[1]
    typical = np.median(squared) / channels if len(squared) else 0.0
    return np.asarray(values * np.sqrt(weight(squared / max(typical, 1e-300), channels)))


def _kept(strain: np.ndarray, layout: ChannelLayout, tracks: Tracks) -> np.ndarray:
    """Deviations (n, W) shrunk by the noise in their energy (James and Stein, 1961).

    Featureless places become exactly equal, and carry no information on the position (paper, III-D). Outside
    the feature's region, if the scene gives one, deviations are set to zero.
    """
    scene = tracks.scene
    energy = layout.mean(_smoothed(strain**2, tracks.slices, _points(_CORRELATED, tracks)))
    kept = np.maximum(1.0 - 2.0 / np.maximum(energy, 1e-9), 0.0)
    if scene.feature is not None:
        kept = kept * phalanges_on_feature(scene, tracks.positions)
    return np.asarray(layout.expand(kept))


def _points(length: float, tracks: Tracks) -> int:
    """Number of points of a track in a length, m."""
    return max(round(length / tracks.pitch), 1)


def _smoothed(values: np.ndarray, slices: list[slice], width: int) -> np.ndarray:
    """Moving averages of values (n, C) over points along each track, as if those at its ends continued."""
    from scipy.ndimage import uniform_filter1d

    return np.concatenate([uniform_filter1d(values[own], width, axis=0, mode="nearest") for own in slices])
