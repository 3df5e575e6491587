"""Tracks of each phalanx: its own, and what other phalanges of the hand felt at the same places.

All phalanges feel the same material, so the strain of one is nearly a linear function of what another felt
there, less what featureless material feels like. Where their paths overlap, each place is known from twice as
many sweeps.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from typing import NamedTuple

import numpy as np

from tactile_localizer.core.geometry.motion import levers
from tactile_localizer.core.geometry.phalanges import turned_offsets
from tactile_localizer.core.scan.tracks import PITCH, Expectation, NearestPoints, Track, evenly, expectation
from tactile_localizer.scene import Scene

_PAIRS = 3
"""Pairs of tracks that a place is interpolated from, twice as many with those of other phalanges: the
components of its mixture. One pair is 0.1 mm worse on one of two simulated features and 0.1 mm better on the
other; six are as three."""
_SOURCES = 2
"""Phalanges from which a phalanx takes tracks, those nearest to it."""
_OFFSET_STD = 0.001
"""Standard deviation of the error of the offset between two phalanges in a scene, m. By judgement."""
_RIDGE = 1e-3
"""Regularization of a transfer, in mean squares of the source's channels."""
_ITERATIONS = 3
_PLACES = 100, 300
"""Least number of places that both phalanges must have felt, and the most that are compared."""
_LARGEST_ERROR = 0.5
"""Largest error of a transfer on held-out sweeps, as a fraction of the squared strain. By judgement: 0.05 to
0.5 on two simulated hands, 0.6 to 1.1 on one where the scene's offsets were wrong by a centimetre."""


class Transfer(NamedTuple):
    """What one phalanx would have felt where another one was.

    Parameters
    ----------
    source, target : indices of the phalanges
    matrix : (C_target, C_source) from the source's strain to the target's
    displacement : (d,) m, of the source, beyond the offsets in the scene
    """

    source: int
    target: int
    matrix: np.ndarray
    displacement: np.ndarray

    def apply(self, track: Track, scene: Scene) -> Track:
        """The target's track: the palm positions at which it is where the source was, and its strain."""
        positions = track.positions + _between(scene, self.source, self.target, track.positions)
        strain = track.strain[:, scene.layout.slices[self.source]] @ self.matrix.T
        return Track(positions + self.displacement, strain, transferred=True)


class PhalanxTracks:
    """Interpolates the strain of each phalanx between the tracks around a place.

    Parameters
    ----------
    tracks : one for each sweep
    scene : what is modelled
    spacing : m between neighbouring tracks
    transfers : between phalanges
    """

    def __init__(
        self, tracks: Sequence[Track], scene: Scene, spacing: float, transfers: Sequence[Transfer] = ()
    ) -> None:
        self.tracks, self.spacing = list(tracks), spacing
        self._scene = scene
        self._sweeps = list(range(len(self.tracks)))
        self._transferred = [
            (transfer.target, index, transfer.apply(track, scene))
            for transfer in transfers
            for index, track in enumerate(self.tracks)
        ]

    def without(self, *sweeps: int) -> PhalanxTracks:
        """Without the tracks at these indices, and without what other phalanges felt along the first.

        A sweep that is held out stands for one that passes between the lines of the scan.
        """
        other = copy(self)
        other._sweeps = [index for index in self._sweeps if index not in sweeps]
        along = self.tracks[sweeps[0]].positions
        other._transferred = [
            each for each in self._transferred if each[1] not in sweeps and not self._repeats(each[2], along)
        ]
        return other

    def expectation(self, scene: Scene, places: np.ndarray, components: int = 0) -> Expectation:
        """Expected strains at ``places`` (M, d) in ``scene``, which may be a part of the whole one.

        ``components`` is the most per place, for a single phalanx; zero: the default.
        """
        own = [self.tracks[index] for index in self._sweeps]
        if not self._transferred:
            return expectation(own, scene, places, self.spacing, components or _PAIRS)
        parts = [
            expectation(tracks, scene, places, self.spacing, components or 2 * _PAIRS)
            for tracks in self._by_phalanx(own)
        ]
        mean, error = (np.concatenate([part[field] for part in parts], axis=-1) for field in (0, 1))
        noise, transferred, log_prior = (
            np.concatenate([part[field] for part in parts], axis=-1) for field in (2, 3, 4)
        )
        return Expectation(mean, error, noise, transferred, log_prior, parts[0].distance)

    def _by_phalanx(self, own: Sequence[Track]) -> Iterator[list[Track]]:
        for phalanx, channels in enumerate(self._scene.layout.slices):
            yield [
                *(Track(track.positions, track.strain[:, channels]) for track in own),
                *(track for target, _, track in self._transferred if target == phalanx),
            ]

    def _repeats(self, track: Track, positions: np.ndarray) -> bool:
        """Whether a track runs along ``positions`` (n, d) rather than beside them."""
        scale = levers(self._scene)
        some = positions[:: max(1, len(positions) // 20)] * scale
        points = track.positions * scale
        reach = np.maximum(points.min(axis=0) - some.max(axis=0), some.min(axis=0) - points.max(axis=0)).max()
        limit = 0.5 * self.spacing
        return bool(reach < limit and np.median(NearestPoints(some).among(points)[0]) < limit)


def fit_transfers(tracks: Sequence[Track], scene: Scene, spacing: float) -> list[Transfer]:
    """Transfers between phalanges that felt the same places of material with featureless parts.

    ``tracks`` have zero strain where the material is featureless.
    """
    if not {"x", "y"} <= set(scene.axis_names) or len(tracks) < 2:
        return []
    offsets = np.array([phalanx.offset for phalanx in scene.phalanges])
    found = []
    for target, offset in enumerate(offsets):
        by_distance = np.argsort(np.linalg.norm(offsets - offset, axis=1), kind="stable")
        sources = [source for source in by_distance.tolist() if source != target][:_SOURCES]
        found += [_fit_transfer(tracks, scene, spacing, source, target) for source in sources]
    return [transfer for transfer in found if transfer is not None]


def _fit_transfer(
    tracks: Sequence[Track], scene: Scene, spacing: float, source: int, target: int
) -> Transfer | None:
    """By Gauss-Newton over the displacement; ``None`` where sweeps that are held out disprove it."""
    layout = scene.layout
    sources = [Track(track.positions, track.strain[:, layout.slices[source]]) for track in tracks]
    places = np.concatenate([t.positions + _between(scene, target, source, t.positions) for t in tracks])
    felt = np.concatenate([track.strain[:, layout.slices[target]] for track in tracks])
    sweep = np.repeat(np.arange(len(tracks)), [len(track.strain) for track in tracks])
    axes = [scene.axis_names.index(name) for name in ("x", "y")]
    displacement, steps = np.zeros(scene.dimension), PITCH * np.eye(scene.dimension)[axes]
    prior = np.eye(len(axes)) / _OFFSET_STD**2

    def strain_at(displaced: np.ndarray) -> np.ndarray:
        return expectation(sources, scene, places - displaced, spacing, 1).mean[:, 0]

    least, most = _PLACES
    inside = np.flatnonzero(((places >= scene.lower) & (places <= scene.upper)).all(axis=1))
    if len(inside) < least:
        return None
    some = inside[evenly(len(inside), 20 * most)]  # of a large scan a part is enough
    places, felt, sweep = places[some], felt[some], sweep[some]
    is_felt = felt.any(axis=1) | strain_at(displacement).any(axis=1)
    places, felt, sweep = places[is_felt], felt[is_felt], sweep[is_felt]
    if len(places) < least:
        return None
    kept = evenly(len(places), most)
    places, felt, sweep = places[kept], felt[kept], sweep[kept]
    for _ in range(_ITERATIONS):
        strain = strain_at(displacement)
        matrix = _regression(strain, felt)
        residual = (felt - strain @ matrix.T).ravel()
        changes = [strain_at(displacement + step) - strain for step in steps]
        slopes = np.stack([(change @ matrix.T).ravel() for change in changes]) / PITCH
        # What differs between two sweeps recurs from place to place: each counts as one observation.
        variance = max(residual @ residual / len(np.unique(sweep)), np.finfo(np.float64).tiny)
        precision = slopes @ slopes.T / variance + prior
        gradient = slopes @ residual / variance - prior @ displacement[axes]
        displacement[axes] += np.linalg.solve(precision, gradient)
    strain, error = strain_at(displacement), 0.0
    for each in np.unique(sweep):
        held_out = sweep == each
        matrix = _regression(strain[~held_out], felt[~held_out])
        error += np.sum((felt[held_out] - strain[held_out] @ matrix.T) ** 2)
    if error >= _LARGEST_ERROR * np.sum(felt**2):
        return None
    return Transfer(source, target, _regression(strain, felt), displacement)


def _regression(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Matrix (C_target, C_source) from strains (N, C_source) to (N, C_target), by ridge regression."""
    squares = source.T @ source
    ridge = max(_RIDGE * np.trace(squares) / len(squares), np.finfo(np.float64).tiny)
    return np.asarray(np.linalg.solve(squares + ridge * np.eye(len(squares)), source.T @ target).T)


def _between(scene: Scene, first: int, second: int, positions: np.ndarray) -> np.ndarray:
    """Offset of one phalanx from another at palm ``positions`` (n, d), (n, d)."""
    return turned_offsets(scene, scene.phalanges[first], positions) - turned_offsets(
        scene, scene.phalanges[second], positions
    )
