"""Held-out sweeps of a scan, or parts of them, each localized on a map without it.

Sweeps on the map show how well a hand is localized. Where others were scanned on the same way in another
session, with another grip or on another day, the map is without all of the sweep's session. Parts of sweeps
on a map of which their surroundings are left out are other material of the same kind: there every claim is
false.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from tactile_localizer.core.calibration.sweep_model import SweepModel
from tactile_localizer.core.geometry.motion import MotionModel, levers
from tactile_localizer.core.geometry.surroundings import surroundings
from tactile_localizer.core.localizer import Localizer
from tactile_localizer.core.measurements import Measurement
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.tracks import PITCH, Tracks, evenly
from tactile_localizer.scene import Scene

_SWEEPS = 24
"""Most sweeps that are held out."""
_MAPS = 6
"""Maps without a sweep; of more sweeps, two that are far from each other are left out of one."""
_LEAST_STRAINS = 10
"""Fewest strains of a held-out sweep, or of a part of one."""
_EACH = 4
"""Measurement updates from one that is scored to the next."""
LEAST_PROBABILITY = 0.005
"""Least probability that is scored: a belief that gives less to the truth is wrong, how much less says
nothing of others."""
_ALIKE = 0.25
"""Part of the belief that is elsewhere, from which another place feels alike."""
_PERIOD_NS = 10_000_000
"""Time between two strains, ns: so slow that each update distance leads to a measurement update."""

Build = Callable[[SweepModel, Sequence[np.ndarray], Scene], list[Localizer]]
"""Makes localizers over a scene, each on the map of a model without some of its tracks (S,) bool."""


@dataclass(frozen=True)
class Outcome:
    """How a held-out sweep, or a part of one, was localized.

    Parameters
    ----------
    sweep : its number in the scan
    on_map : whether its surroundings are on the map
    score : mean logarithm of the probability given to the truth
    right, wrong : converged and right at its end, and never wrong; ever converged and wrong
    claimed : part of its measurement updates after which it had converged
    since : part of them from the first of these on
    error : (d,) distance of the last estimate from the truth along each axis, m (yaw: rad)
    spread : (d,) its standard deviation along each axis without the registration error, m (yaw: rad)
    axes : (d,) score along each axis alone, over the second half of the way; empty if not on the map
    alike : (d,) m (yaw: rad), from the truth to another place that is as probable at its end; empty: none
    other_session : whether its map is of other sessions
    last_known : (d,) where it was when it was last converged and right, m (yaw: rad); empty: nowhere
    """

    sweep: int
    on_map: bool
    score: float
    right: bool
    wrong: bool
    claimed: float
    since: float
    error: tuple[float, ...]
    spread: tuple[float, ...]
    axes: tuple[float, ...] = ()
    alike: tuple[float, ...] = ()
    other_session: bool = False
    last_known: tuple[float, ...] = ()

    @property
    def converged(self) -> bool:
        """Whether it ever converged."""
        return self.claimed > 0.0

    @property
    def lost(self) -> bool:
        """Whether it converged, was never wrong, and is not right at its end."""
        return self.converged and not self.wrong and not self.right


class HeldOut(NamedTuple):
    """A sweep that is held out.

    Parameters
    ----------
    number, track : of the sweep
    positions, strain : (n, d) and (n, C), of its samples
    session : (S,) bool, tracks of its session, if others lie on its way
    """

    number: int
    track: int
    positions: np.ndarray
    strain: np.ndarray
    session: np.ndarray | None = None


@dataclass(frozen=True)
class Trial:
    """A held-out sweep, or a part of it, and a localizer that does not know it."""

    sweep: HeldOut
    on_map: bool
    localizer: Localizer
    other_session: bool = False

    @cached_property
    def measurements(self) -> list[tuple[int, Measurement]]:
        """What the localizer takes in, with the noise of odometry: row of the sweep and measurement."""
        localizer, (_, track, positions, strains, _) = self.localizer, self.sweep
        scene, taken = localizer.scene, localizer.measurements
        rng = np.random.default_rng(track)
        steps = rng.standard_normal(positions.shape) * scene.motion_std
        odometry = positions + np.cumsum(steps * np.sqrt(_travels(positions, scene))[:, None], axis=0)
        present, found = scene.layout.every, []
        taken.reset()
        for row, (place, strain) in enumerate(zip(odometry, strains, strict=True)):
            measurement = taken.observe((1 + row) * _PERIOD_NS, place, strain, present)
            if measurement is not None:
                found.append((row, measurement))
        return found

    @cached_property
    def outcomes(self) -> dict[tuple[float, float], Outcome]:
        """How it was localized, by the information and the explanation length, m."""
        return {}

    def localize(self, information_length: float, explanation_length: float) -> Outcome:
        """How it is localized, scoring what is published of the truth; done once for the same lengths."""
        lengths = information_length, explanation_length
        if lengths not in self.outcomes:
            self.outcomes[lengths] = self._localized(*lengths)
        return self.outcomes[lengths]

    def _localized(self, information_length: float, explanation_length: float) -> Outcome:
        localizer, (number, _, positions, *_) = self.localizer, self.sweep
        scene, radius = localizer.scene, localizer.criteria.radius
        count = len(self.measurements)  # at least one, of the first strain
        localizer.reset()
        localizer.information_length, localizer.explanation_length = information_length, explanation_length
        there = positions[[row for row, _ in self.measurements]]
        pending = np.reshape([each.pending for _, each in self.measurements], there.shape)
        truth, mean, converged = there - pending, np.empty_like(there), np.zeros(count, dtype=bool)
        scores: list[float] = []
        along: list[np.ndarray] = []
        for place, (_, measurement) in enumerate(self.measurements):
            belief = localizer.measure(measurement)
            mean[place], converged[place] = belief.mean, localizer.converged
            if place % _EACH == _EACH - 1:
                scores.append(math.log(max(_probability(self, truth[place]), LEAST_PROBABILITY)))
                if self.on_map:
                    along.append(_along_axes(localizer, truth[place]))
        away = MotionModel(scene).displacement(there, mean + pending)
        right = converged & self.on_map & (np.square(away / radius).sum(axis=1) <= 1.0)
        wrong, claims = bool((converged & ~right).any()), np.flatnonzero(converged)
        travel = np.cumsum([each.travel for _, each in self.measurements])
        scored = zip(travel[_EACH - 1 :: _EACH].tolist(), along, strict=False)
        axes = [each for way, each in scored if 2.0 * way >= travel[-1]]
        if not axes:
            axes = [np.log(np.full(scene.dimension * self.on_map, LEAST_PROBABILITY))]
        return Outcome(
            number,
            self.on_map,
            float(np.mean(scores)) if scores else 0.0,
            bool(right[-1]) and not wrong,
            wrong,
            len(claims) / count,
            float(count - claims[0]) / count if len(claims) else 0.0,
            tuple(np.abs(away[-1]).tolist()),
            tuple(np.sqrt(np.maximum(belief.covariance.diagonal(), 0.0)).tolist()),
            tuple(np.mean(axes, axis=0).tolist()),
            _place_alike(localizer, truth[-1]) if self.on_map else (),
            self.other_session,
            tuple(truth[right][-1:].ravel().tolist()),
        )


def held_out(scan: Scan, tracks: Tracks, spacing: float) -> list[HeldOut]:
    """Sweeps that are spread across the scan, whose lines are ``spacing`` metres apart.

    Fragments, as of a return stroke that was not recorded, are held out only where there is nothing else.
    """
    positions, strain = scan.positions_on(tracks.scene), scan.strain_on(tracks.scene)
    order = _across(tracks)
    whole = order[tracks.counts[order] >= _LEAST_STRAINS]
    order = whole if len(whole) > 1 else order
    inner = order[1:-1] if len(order) > 4 else order  # the outermost lie beside the map of the others
    found = []
    for place in evenly(len(inner), _SWEEPS):
        track = int(inner[place])
        number = int(scan.sweep_numbers[track])  # others may have been dropped before it
        own = scan.sweep == number
        session = _session(scan, tracks, track, spacing) if scan.sessions else None
        found.append(HeldOut(number, track, positions[own], strain[own], session))
    return found


def _session(scan: Scan, tracks: Tracks, track: int, spacing: float) -> np.ndarray | None:
    """Tracks (S,) bool of the session of one of them; ``None``: those of no other session lie on its way."""
    own, way = scan.session == scan.session[track], tracks.positions[tracks.slices[track]]
    away = tracks.nearest(way, np.flatnonzero(~own), 1)[0]
    return own if away.mean() <= max(spacing, PITCH) else None


def _turns(trials: int, sweeps: int, rng: np.random.Generator) -> list[tuple[int, int]]:
    """For each trial which of the ``sweeps`` is localized, and in which of two ways, each in turn."""
    order = rng.permutation(sweeps)
    numbers = [divmod(trial, sweeps) for trial in range(trials)]
    return [(int(order[which]), (which + again) % 2) for again, which in numbers]


def trials_on_map(count: int, model: SweepModel, build: Build, sweeps: Sequence[HeldOut]) -> Iterator[Trial]:
    """``count`` sweeps from their start or from further on, each on the map without it.

    Of few sweeps, each comes several times: from its start it is the same trial again.
    """
    rng = np.random.default_rng(0)
    tracks = model.scan.tracks
    without = []
    for place, sweep in enumerate(sweeps):
        others = [each.track for each in sweeps[place % _MAPS :: _MAPS]]
        without.append(np.isin(np.arange(len(tracks)), others) if sweep.session is None else sweep.session)
    maps, of_sweep = np.unique(without, axis=0, return_inverse=True)
    made = build(model, list(maps), tracks.scene)
    localizers = [made[number] for number in of_sweep.ravel().tolist()]
    trials: dict[tuple[int, float], Trial] = {}
    for which, begins_late in _turns(count, len(sweeps), rng):
        begin = rng.uniform(0.15, 0.6) if begins_late else 0.0
        if (which, begin) not in trials:
            part = _part(sweeps[which], np.arange(len(sweeps[which].positions)), begin, tracks.scene)
            trials[which, begin] = Trial(part, True, localizers[which], part.session is not None)
        yield trials[which, begin]


def trials_off_map(count: int, model: SweepModel, build: Build, sweeps: Sequence[HeldOut]) -> Iterator[Trial]:
    """``count`` parts of sweeps in one half of the map, each on the other half."""
    rng = np.random.default_rng(1)
    tracks = model.scan.tracks
    extent = np.array([np.ptp(tracks.positions[own], axis=0) for own in tracks.slices]) * levers(tracks.scene)
    along = int(np.median(extent, axis=0).argmax())
    middle = 0.5 * float(tracks.positions[:, along].min() + tracks.positions[:, along].max())
    localizers = []
    for side in (False, True):
        kept = (tracks.positions[:, along] > middle) == side
        if kept.any() and not kept.all():
            within = surroundings(tracks.scene, tracks.positions[kept])
            half = model.part(kept)
            none = np.zeros(len(half.scan.tracks), dtype=bool)
            localizers += [(side, localizer) for localizer in build(half, [none], within)]
    if not localizers:
        return
    for which, way in _turns(count, len(sweeps), rng):
        side, localizer = localizers[way % len(localizers)]
        rows = np.flatnonzero((sweeps[which].positions[:, along] > middle) != side)
        begin = rng.uniform(0.0, 0.5)
        if len(rows):
            part = _part(sweeps[which], rows, begin, tracks.scene)
            if len(part.positions) >= _LEAST_STRAINS:
                yield Trial(part, False, localizer)


def _part(sweep: HeldOut, rows: np.ndarray, begin: float, scene: Scene) -> HeldOut:
    """A sweep's ``rows`` (n,) after a part ``begin`` of the way.

    A hand that rests, as after a sweep until it is ended, is on no way.
    """
    motion, positions = MotionModel(scene), sweep.positions[rows]
    farthest = np.maximum.accumulate(motion.travels(motion.displacement(positions[0], positions)))
    on_the_way = np.flatnonzero(np.diff(farthest, prepend=-1.0) > 0.0)
    rows = rows[on_the_way[int(begin * len(on_the_way))] :]
    return sweep._replace(positions=sweep.positions[rows], strain=sweep.strain[rows])


def _across(tracks: Tracks) -> np.ndarray:
    """Tracks (S,) in the order of their mean positions along the axis on which these differ most."""
    means = np.array([tracks.positions[own].mean(axis=0) for own in tracks.slices]) * levers(tracks.scene)
    return means[:, np.ptp(means, axis=0).argmax()].argsort(kind="stable")


def _travels(positions: np.ndarray, scene: Scene) -> np.ndarray:
    """Travel (n,) to each of positions (n, d) from the one before it, m."""
    motion = MotionModel(scene)
    return motion.travels(motion.wrapped(np.diff(positions, axis=0, prepend=positions[:1])))


def _probability(trial: Trial, truth: np.ndarray) -> float:
    """What the localizer gives to the truth: being on the map and near it, or not being on the map."""
    localizer = trial.localizer
    if not trial.on_map:
        return 1.0 - localizer.explanations.on_map
    return localizer.explanations.tracked * localizer.probability_near(truth, *localizer.hypotheses())


def _place_alike(localizer: Localizer, truth: np.ndarray) -> tuple[float, ...]:
    """Displacement (d,) from the truth to the most probable place beyond twice the radius, m (yaw: rad).

    Empty where less than :data:`_ALIKE` of the belief is there.
    """
    states, weights = localizer.hypotheses()
    away = MotionModel(localizer.scene).displacement(truth, states)
    there = weights * (np.square(away / localizer.criteria.radius).sum(axis=1) > 4.0)
    return tuple(away[there.argmax()].tolist()) if there.sum() > _ALIKE else ()


def _along_axes(localizer: Localizer, truth: np.ndarray) -> np.ndarray:
    """Logarithms (d,) of the belief within the radius of the truth along each axis alone."""
    states, weights = localizer.hypotheses()
    away = MotionModel(localizer.scene).displacement(truth, states)
    near = weights @ (np.abs(away) <= localizer.criteria.radius)
    return np.asarray(np.log(np.maximum(near, LEAST_PROBABILITY)))
