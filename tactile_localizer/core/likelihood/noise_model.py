"""Noise of one visit to a place, estimated from the differences between the sweeps of a scan.

The map, the alternatives to it and the offset of a sweep all use this noise model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.geometry.phalanges import phalanges_on_feature
from tactile_localizer.core.likelihood.drift import innovations
from tactile_localizer.core.likelihood.material import CLOTH, SHEET, Material
from tactile_localizer.core.likelihood.student_t import scatter
from tactile_localizer.core.likelihood.white_noise import WhiteNoise, white_noise
from tactile_localizer.core.scan.lines import line_spacing
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.tracks import (
    PAIRS,
    PITCH,
    Expectation,
    Track,
    evenly,
    expectation,
    tracks_of,
)
from tactile_localizer.scene import Scene

_DIAGONAL_LOADING = 0.05
"""Fraction of each channel's variance that is added to the diagonal of the covariance."""
_FEATURELESS_STRETCH = 0.2
"""Length of the stretch that varies least, from which the featureless strain of a sweep is taken, as a
fraction of the sweep."""
_REPRODUCIBLE = 0.15
"""Product of the deviations of two neighbouring sweeps, in variances of the noise, above which a place has a
signal; the noise of two sweeps is independent. By judgement."""
_MOSTLY_FEATURELESS = 0.35
"""Fraction of places without a reproducible signal above which a material is featureless between features:
0.4 to 0.7 on simulated sheets, at most 0.31 on fabrics."""
BEFORE = 10
"""Innovations at the beginning of a sweep that are left out, where the trend is hardly known."""
_MAX_HELD_OUT = 100
"""Largest number of sweeps that are compared with the others, which suffices for a few dozen parameters."""
_SMOOTHING = 0.002
"""m over which the energy of a deviation is averaged."""


class Residuals(NamedTuple):
    """A held-out track, its residuals (n, K, C) from the expectation by the other tracks, and that."""

    visit: Track
    residual: np.ndarray
    expected: Expectation

    def thinned(self, most: int = 200) -> Residuals:
        """At most about ``most`` of the points, evenly spread."""
        rows = np.arange(0, len(self.residual), max(1, len(self.residual) // most))
        visit = Track(self.visit.positions[rows], self.visit.strain[rows])
        return Residuals(visit, self.residual[rows], Expectation(*(part[rows] for part in self.expected)))


@dataclass(frozen=True)
class NoiseModel:
    """Linear transform to whitened strains, in which the noise of each phalanx has unit covariance.

    Parameters
    ----------
    layout : channels of the strain by phalanx
    centre : (C,) V, subtracted from every strain
    whitening : (C, C) block-diagonal; ``whitening @ (strain - centre)`` are whitened strains
    log_volume : (F,) logarithms of the determinants of its blocks, for densities over strains in volts
    offset_variance : (C,) whitened variance of the level of a new sweep; infinite: it is unknown
    turning : (C,) change of the whitened featureless strain per rad of yaw: friction turns with the hand
    white : white noise of the scan's channels
    """

    layout: ChannelLayout
    centre: np.ndarray
    whitening: np.ndarray
    log_volume: np.ndarray
    offset_variance: np.ndarray
    turning: np.ndarray
    white: WhiteNoise

    def rewhitening(self, excess: np.ndarray) -> np.ndarray:
        """Transform (C, C) of whitened strains that whitens a noisier visit.

        ``excess`` (C,), V^2, is the variance by which each raw channel is noisier.
        """
        transform = np.zeros_like(self.whitening)
        for own in self.layout.slices:
            block = self.whitening[own, own]
            covariance = np.eye(len(block)) + (block * excess[own]) @ block.T
            transform[own, own] = np.linalg.inv(np.linalg.cholesky(covariance))
        return transform

    @cached_property
    def variance(self) -> np.ndarray:
        """Variance (C,), V^2, of a visit in raw channels."""
        return np.asarray(np.square(np.linalg.inv(self.whitening)).sum(axis=1))

    def whitened(self, strain: np.ndarray) -> np.ndarray:
        """Strains (..., C), V, in whitened coordinates."""
        return (strain - self.centre) @ self.whitening.T


class WhitenedScan(NamedTuple):
    """The tracks of a scan in the coordinates in which the noise of a visit is white, and the noise model.

    Parameters
    ----------
    model : the noise model
    tracks : whitened; without their offsets and, where nothing is reproducible, exactly zero
    visits : the same tracks, not shrunk, against which predictions are evaluated
    recorded : the tracks with their strains as they were recorded, V
    offsets : (S, C) V, by which each track's strains are moved, but for what turns with yaw; zero where no
        offset is known
    spacing : of the tracks, m
    material : what the model takes from the kind of the material
    """

    model: NoiseModel
    tracks: list[Track]
    visits: list[Track]
    recorded: list[Track]
    offsets: np.ndarray
    spacing: float
    material: Material


def estimate_noise(scan: Scan, scene: Scene) -> WhitenedScan:
    """Estimate the noise of one visit from how the scan's sweeps differ.

    Raises
    ------
    SceneError
        The scene names an axis or a phalanx that the scan does not have.
    """
    recorded = tracks = tracks_of(scan, scene)
    spacing = line_spacing(tracks, scene)
    resolution = _resolution(scan.strain_on(scene))
    first = _whitening(_between_sweeps(tracks, scene, spacing, np.inf), resolution, scene.layout)
    flat = [_featureless_strain(track.strain @ first.T) for track in tracks]
    level = np.array(flat) @ np.linalg.inv(first).T
    moved = [Track(track.positions, track.strain - own) for track, own in zip(tracks, level, strict=True)]
    is_sheet = len(tracks) > 1 and _is_featureless(moved, first, scene, spacing)
    material = SHEET if is_sheet else CLOTH
    turning = _turning(level, recorded, scene) if material.has_level else np.zeros(scene.layout.size)
    layout = ChannelLayout((scene.layout.size,)) if material.joint_noise else scene.layout
    if material.has_level:
        level = level - np.outer(_yaws(recorded, scene), turning)
        tracks, centre = moved, level.mean(axis=0)
        differences = _between_sweeps(tracks, scene, spacing)
    else:
        centre = np.mean([track.strain.mean(axis=0) for track in tracks], axis=0)
        tracks = [Track(track.positions, track.strain - centre) for track in tracks]
        differences = _between_sweeps(tracks, scene, spacing, material.memory)
    whitening = _whitening(differences, resolution, layout)
    # Without featureless places an offset cannot be distinguished from a change of place.
    variance = np.full(scene.layout.size, np.inf)
    if material.has_level:
        variance = material.session_ratio * _offset_variance(level @ whitening.T, scene.layout)
    log_volume = np.array([np.log(np.diag(whitening)[own]).sum() for own in layout.slices])
    model = NoiseModel(
        layout, centre, whitening, log_volume, variance, whitening @ turning, white_noise(scan, scene)
    )
    visits = [Track(track.positions, track.strain @ whitening.T) for track in tracks]
    shown = visits
    if material.has_level:
        shown = [_shrink(track, scene) for track in visits]
    moved_by = level - level.mean(axis=0) if material.has_level else np.zeros_like(level)
    return WhitenedScan(model, shown, visits, recorded, moved_by, spacing, material)


def held_out(
    tracks: Sequence[Track], visits: Sequence[Track], scene: Scene, spacing: float, components: int = PAIRS
) -> list[Residuals]:
    """At most :data:`_MAX_HELD_OUT` of the visits, less what the *other* tracks let one expect of them."""
    found = []
    for index in evenly(len(visits), _MAX_HELD_OUT):
        visit = visits[index]
        others = [track for other, track in enumerate(tracks) if other != index]
        expected = expectation(others, scene, visit.positions, spacing, components)
        found.append(Residuals(visit, visit.strain[:, None] - expected.mean, expected))
    return found


def _between_sweeps(
    tracks: Sequence[Track], scene: Scene, spacing: float, memory: float | None = None
) -> list[np.ndarray]:
    """Differences of each track from the others, (n, C), scaled to the variance of one visit.

    With ``memory``, m, they are innovations, infinite: deviations from the median.
    """
    if len(tracks) == 1:  # the roughness along the sweep is the only measure of noise
        strain = tracks[0].strain
        if len(strain) < 3:
            return [np.zeros_like(strain)]
        return [(strain[1:-1] - 0.5 * (strain[2:] + strain[:-2])) / np.sqrt(1.5)]
    found = []
    for _, residual, expected in held_out(tracks, tracks, scene, spacing, 1):
        inside = expected.distance <= 2.0 * max(spacing, 2.0 * PITCH)
        rows = inside if inside.any() else np.ones(len(inside), dtype=bool)
        difference = residual[:, 0] / np.sqrt(1.0 + expected.noise)
        if memory is not None and np.isfinite(memory):
            difference = innovations(difference, memory, PITCH, robust=True)
            rows = rows & (np.arange(len(rows)) >= min(BEFORE, len(rows) // 2))
        elif memory is not None:
            difference = difference - np.median(difference[rows], axis=0)
        found.append(difference[rows])
    return found


def _whitening(
    differences: Sequence[np.ndarray], resolution: np.ndarray, layout: ChannelLayout
) -> np.ndarray:
    """Inverse Cholesky factor of the robust scatter of differences, a block per phalanx."""
    joined = np.concatenate(differences)
    whitening = np.zeros((joined.shape[1],) * 2)
    for own in layout.slices:
        # Scaled per channel, so that the result does not depend on the unit.
        unit = np.maximum(np.sqrt(np.mean(joined[:, own] ** 2, axis=0)), resolution[own])
        matrix = scatter(joined[:, own] / unit)
        matrix += np.diag(_DIAGONAL_LOADING * matrix.diagonal() + (resolution[own] / unit) ** 2 / 12.0)
        whitening[own, own] = np.linalg.inv(np.linalg.cholesky(matrix)) / unit
    return whitening


def _resolution(strain: np.ndarray) -> np.ndarray:
    """Quantization step of each channel, (C,), the smallest difference between its values."""
    sample = np.sort(strain[:: max(1, len(strain) // 20_000)], axis=0)
    steps = np.diff(sample, axis=0)
    smallest = np.where(steps > 0.0, steps, np.inf).min(axis=0, initial=np.inf)
    floor = 1e-9 * np.abs(strain).max(axis=0) + 1e-30
    return np.maximum(np.where(np.isfinite(smallest), smallest, 0.0), floor)


def _featureless_strain(strain: np.ndarray) -> np.ndarray:
    """Mean (C,) of the stretch of a sweep that varies least."""
    width = max(3, round(_FEATURELESS_STRETCH * len(strain)))
    if len(strain) <= width:
        return np.asarray(np.median(strain, axis=0))
    middle = np.median(strain, axis=0)  # in squares of a large offset the signal would be lost
    deviation = np.vstack([np.zeros(strain.shape[1]), strain - middle])
    sums, squares = np.cumsum(deviation, axis=0), np.cumsum(deviation**2, axis=0)
    mean = (sums[width:] - sums[:-width]) / width
    variance = (squares[width:] - squares[:-width]) / width - mean**2
    return np.asarray(middle + mean[variance.sum(axis=1).argmin()])


def _yaws(tracks: Sequence[Track], scene: Scene) -> np.ndarray:
    """Mean yaw (S,) of each track, rad; zero where the scene does not name it or it is a full turn."""
    names = scene.axis_names
    if "yaw" not in names or scene.wraps[names.index("yaw")]:
        return np.zeros(len(tracks))
    return np.array([track.positions[:, names.index("yaw")].mean() for track in tracks])


def _turning(level: np.ndarray, tracks: Sequence[Track], scene: Scene) -> np.ndarray:
    """Change of the tracks' featureless strains (S, C) per rad of yaw, by least squares: (C,) V/rad."""
    yaw = _yaws(tracks, scene)
    away = yaw - yaw.mean()
    spread = float(away @ away)
    return np.asarray(away @ level / spread) if spread > 0.0 else np.zeros(level.shape[1])


def _offset_variance(offsets: np.ndarray, layout: ChannelLayout) -> np.ndarray:
    """Variance (C,) of the sweeps' offsets (S, C), averaged with its mean over the phalanx (few sweeps)."""
    variance = offsets.var(axis=0, ddof=1)
    return np.asarray(0.5 * (variance + layout.expand(_means(layout, variance))))


def _is_featureless(tracks: Sequence[Track], whitening: np.ndarray, scene: Scene, spacing: float) -> bool:
    """Whether most places are featureless: their deviations are not reproduced by neighbouring sweeps."""
    whitened = [Track(track.positions, track.strain @ whitening.T) for track in tracks]
    shares = []
    for visit, residual, _ in held_out(whitened, whitened, scene, spacing, 1):
        product = visit.strain * (visit.strain - residual[:, 0])
        shares.append(_means(scene.layout, _smoothed(product)) < _REPRODUCIBLE)
    return bool(np.mean(np.concatenate(shares)) > _MOSTLY_FEATURELESS)


def _shrink(track: Track, scene: Scene) -> Track:
    """A track with its deviations shrunk by the noise in their energy (James and Stein, 1961).

    Featureless places become exactly equal, and carry no information on the position (paper, III-D). Outside
    the feature's region, if the scene gives one, deviations are set to zero.
    """
    strain = track.strain
    energy = _means(scene.layout, _smoothed(strain**2))
    strain = strain * scene.layout.expand(np.maximum(1.0 - 2.0 / np.maximum(energy, 1e-9), 0.0))
    if scene.feature is not None:
        on = phalanges_on_feature(scene, track.positions)
        strain = strain * scene.layout.expand(on.astype(np.float64))
    return Track(track.positions, strain)


def _smoothed(values: np.ndarray) -> np.ndarray:
    return moving_average(values, round(_SMOOTHING / PITCH))


def moving_average(values: np.ndarray, width: int) -> np.ndarray:
    """Averages over ``width`` of values (n, C) along a track, padded by the values at its ends."""
    padded = np.pad(values, ((width // 2, (width - 1) // 2), (0, 0)), mode="edge")
    return np.asarray(np.lib.stride_tricks.sliding_window_view(padded, width, axis=0).mean(axis=-1))


def _means(layout: ChannelLayout, values: np.ndarray) -> np.ndarray:
    """Means over the channels of each phalanx, (..., C) to (..., F)."""
    return layout.sum(values) / np.array(layout.counts)
