"""Examination of a scan: its own sweeps, held out and localized on the map without them.

All strains of a sweep share errors of the map, so a strain is worth less than an independent measurement, and
how much less depends on the material, the sensor and the scan. The *information length*, the travel per
independent measurement, is that with the best log score: the mean logarithm of the probability that is given
to the truth, a proper scoring rule (Gneiting and Raftery, 2007). So the learning rate of a generalized
posterior (Bissiri, Holmes and Walker, 2016) is learned.

The score is that of sweeps on the map. Parts of sweeps on a map of which their surroundings are left out are
other material of the same kind: there every claim is false. Lengths at which false claims are more than
chance are not chosen. Where an axis is known no better than by ignorance, it is the longest length: nothing
that was scanned tells places along it apart.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from tactile_localizer.core.calibration.sweep_model import SweepModel
from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.geometry.motion import MotionModel, levers
from tactile_localizer.core.geometry.surroundings import surroundings
from tactile_localizer.core.hypotheses.convergence import probability_within
from tactile_localizer.core.localizer import Localizer
from tactile_localizer.core.measurements import Measurement
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.tracks import Tracks, evenly
from tactile_localizer.scene import Scene

LENGTHS = (0.0017, 0.003, 0.005, 0.0085, 0.015, 0.025, 0.05)
"""Information lengths to choose from, m; the search begins in the middle."""
UNEXAMINED = LENGTHS[len(LENGTHS) // 2]
"""Information length where no sweep can be held out, m."""
_TRIALS, _FEW = 48, 12
"""Sweeps, or parts of them, that are localized on the map, and off it: at the lengths that may be the best,
and at others."""
_CLEAR = 4.0
"""Standard errors of the difference of two scores of a few trials beyond which more trials are not needed."""
_CONCEDED = -math.log(Configuration().convergence_probability)
"""Score of a belief that just converges."""
_SWEEPS = 24
"""Most sweeps that are held out."""
_MAPS = 6
"""Maps without a sweep; of more sweeps, two that are far from each other are left out of one."""
_LEAST_STRAINS = 10
"""Strains of a part of a sweep that is localized."""
_EACH = 4
"""Measurement updates from one that is scored to the next."""
_LEAST_PROBABILITY = 0.005
"""Least probability that is scored: a belief that gives less to the truth is wrong, how much less says
nothing of others."""
_ALIKE = 0.25
"""Part of the belief that is elsewhere, from which another place feels alike."""
_PERIOD_NS = 10_000_000
"""Time between two strains, ns: so slow that each update distance leads to a measurement update."""

Build = Callable[[SweepModel, Scene], Localizer]
Progress = Callable[[float], None]


@dataclass(frozen=True)
class Outcome:
    """How a held-out sweep, or a part of one, was localized.

    Parameters
    ----------
    sweep : its number in the scan
    on_map : whether its surroundings are on the map
    score : mean logarithm of the probability given to the truth
    right, wrong, converged : converged and right at its end, and never wrong; ever converged and wrong; ever
        converged
    error : (d,) distance of the last estimate from the truth along each axis, m (yaw: rad)
    spread : (d,) its standard deviation along each axis without the registration error, m (yaw: rad)
    axes : (d,) score along each axis alone, over the second half of the way; empty if not on the map
    alike : (d,) m (yaw: rad), from the truth to another place that is as probable at its end; empty: none
    """

    sweep: int
    on_map: bool
    score: float
    right: bool
    wrong: bool
    converged: bool
    error: tuple[float, ...]
    spread: tuple[float, ...]
    axes: tuple[float, ...] = ()
    alike: tuple[float, ...] = ()

    @property
    def lost(self) -> bool:
        """Whether it converged, was never wrong, and is not right at its end."""
        return self.converged and not self.wrong and not self.right


@dataclass(frozen=True)
class Examination:
    """What the held-out sweeps of a scan show.

    Parameters
    ----------
    information_length : travel per independent measurement, m
    ignorance : score of a uniform belief on the map
    ignorance_axes : (d,) the same along each axis alone
    outcomes : of the sweeps, at that length
    scores : of the lengths that were tried, m: on the map, and on other material (``None``: not tried)
    """

    information_length: float = UNEXAMINED
    ignorance: float = 0.0
    ignorance_axes: tuple[float, ...] = ()
    outcomes: tuple[Outcome, ...] = ()
    scores: tuple[tuple[float, float, float | None], ...] = ()

    @cached_property
    def on_map(self) -> tuple[Outcome, ...]:
        """Outcomes on the map."""
        return tuple(each for each in self.outcomes if each.on_map)

    @cached_property
    def off_map(self) -> tuple[Outcome, ...]:
        """Outcomes on other material of the same kind."""
        return tuple(each for each in self.outcomes if not each.on_map)

    @property
    def score(self) -> float:
        """Mean score on the map; that of ignorance where nothing was held out."""
        return _mean([each.score for each in self.on_map]) if self.on_map else self.ignorance

    @property
    def observed(self) -> np.ndarray:
        """Part (d,) of what there is to know along each axis that the sweeps know on their second half.

        One where the position is sure and right, zero where it is as good as ignorance; less: worse.
        """
        score = np.mean([each.axes for each in self.on_map], axis=0)
        return np.asarray(1.0 - score / np.minimum(self.ignorance_axes, -1e-9))

    @property
    def error(self) -> np.ndarray:
        """Mean error (d,) along each axis of the sweeps that are right, m (yaw: rad); empty where none is."""
        right = [each.error for each in self.on_map if each.right]
        return np.mean(right, axis=0) if right else np.zeros(0)

    @property
    def spread(self) -> np.ndarray:
        """Median over the sweeps of their :attr:`Outcome.spread`, (d,) m (yaw: rad)."""
        return np.median([each.spread for each in self.on_map], axis=0) if self.on_map else np.zeros(0)


class _HeldOut(NamedTuple):
    """A sweep that is held out: its number, its track, and its n positions (n, d) and strains (n, C)."""

    number: int
    track: int
    positions: np.ndarray
    strain: np.ndarray


@dataclass(frozen=True)
class _Trial:
    """A held-out sweep, or a part of it, and a localizer that does not know it."""

    sweep: _HeldOut
    on_map: bool
    localizer: Localizer

    @cached_property
    def measurements(self) -> list[tuple[int, Measurement]]:
        """What the localizer takes in, with the noise of odometry: row of the sweep and measurement."""
        localizer, (_, track, positions, strains) = self.localizer, self.sweep
        scene, taken = localizer.scene, localizer.measurements
        rng = np.random.default_rng(track)
        steps = rng.standard_normal(positions.shape) * scene.motion_std
        odometry = positions + np.cumsum(steps * np.sqrt(_travels(positions, scene))[:, None], axis=0)
        present, found = np.ones(len(scene.phalanges), dtype=bool), []
        taken.reset()
        for row, (place, strain) in enumerate(zip(odometry, strains, strict=True)):
            measurement = taken.observe((1 + row) * _PERIOD_NS, place, strain, present)
            if measurement is not None:
                found.append((row, measurement))
        return found


def examine(
    scan: Scan, models: Sequence[SweepModel], build: Build, progress: Progress | None = None
) -> tuple[int, Examination]:
    """Choose the model and the information length under which held-out sweeps are localized best.

    Parameters
    ----------
    scan : whose sweeps are held out
    models : learned from all of it, one of each kind of material, those that assume less after the others
    build : makes a localizer from a part of a model, over the scene in which that part lies
    progress : called with the completed fraction

    Returns
    -------
    chosen : index of the model
    examination : under that model
    """
    tracks = models[0].scan.tracks
    if len(tracks) < 2:
        return 0, Examination()
    sweeps, done = _held_out(scan, tracks), 0

    def report() -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done / (done + 4.0 * len(models)))

    kinds = [_Kind(model, build, sweeps, report) for model in models]
    for kind in kinds:
        kind.climb()
    best = kinds[0]
    for kind in kinds[1:]:
        best = kind.better_than(best)
    best.refine()
    found = best.examination()
    if (found.observed < 0.0).any():
        best.choice = len(LENGTHS) - 1
        found = best.examination()
    return kinds.index(best), found


class _Kind:
    """Trials under one model, by information length.

    Attributes
    ----------
    choice : number of the best length
    """

    def __init__(
        self, model: SweepModel, build: Build, sweeps: Sequence[_HeldOut], report: Callable[[], None]
    ) -> None:
        self.scene, self._report = model.scan.tracks.scene, report
        self._on_map = list(_trials_on_map(model, build, sweeps, np.random.default_rng(0)))
        self._make_off_map = partial(_trials_off_map, model, build, sweeps, np.random.default_rng(1))
        self._outcomes: dict[tuple[int, bool], list[Outcome]] = {}
        self.choice = LENGTHS.index(UNEXAMINED)

    @cached_property
    def _off_map(self) -> list[_Trial]:
        return list(self._make_off_map())

    def climb(self) -> None:
        """Climb to the length with the best score of a few trials."""
        for step in (-1, 1):
            while 0 <= self.choice + step < len(LENGTHS) and (
                self._scores(self.choice + step, _FEW).mean() > self._scores(self.choice, _FEW).mean()
            ):
                self.choice += step

    def better_than(self, other: _Kind) -> _Kind:
        """The one with the better score, or, where that is open, more trials right at the end, or this one.

        A few trials decide where their scores are far from each other. What the threshold of convergence
        concedes is no difference.
        """
        for count, errors in ((_FEW, _CLEAR), (_TRIALS, 1.0)):
            difference = self._scores(self.choice, count) - other._scores(other.choice, count)
            if _is_distinct(difference, errors) and abs(difference.mean()) > _CONCEDED:
                return self if difference.mean() > 0.0 else other
        right = [sum(each.right for each in kind._localized(kind.choice, True)) for kind in (self, other)]
        return self if right[0] >= right[1] else other

    def refine(self) -> None:
        """Choose among the best length and its neighbours by all trials, then by false claims.

        The next longer lengths are tried where there are more of these than by chance. Where they are as
        many at all lengths, the material resembles itself.
        """
        tried = [each for each in (self.choice - 1, self.choice + 1) if (each, True) in self._outcomes]
        scores = self._scores(self.choice, _FEW)
        close = [each for each in tried if not _is_distinct(scores - self._scores(each, _FEW), 1.0)]
        self.choice = max([self.choice, *close], key=lambda each: self._scores(each).mean())
        for choice in range(self.choice, len(LENGTHS)):
            outcomes = self._localized(choice, True) + self._localized(choice, False)
            if sum(each.wrong for each in outcomes) <= by_chance(len(outcomes)):
                self.choice = choice
                break

    def examination(self) -> Examination:
        """The examination at the best length."""
        ignorance = _ignorance(self.scene, self._on_map[0].localizer.criteria.radius)
        outcomes = self._localized(self.choice, True) + self._localized(self.choice, False)
        scores = []
        for choice in sorted({choice for choice, _ in self._outcomes}):
            by_truth = ([each.score for each in self._outcomes.get((choice, on), ())] for on in (True, False))
            on_map, off_map = (_mean(each) if each else None for each in by_truth)
            if on_map is not None:
                scores.append((LENGTHS[choice], on_map, off_map))
        return Examination(LENGTHS[self.choice], *ignorance, tuple(outcomes), tuple(scores))

    def _scores(self, choice: int, count: int = _TRIALS) -> np.ndarray:
        """Of the first ``count`` trials on the map at a length, (n,)."""
        return np.array([each.score for each in self._localized(choice, True, count)])

    def _localized(self, choice: int, on_map: bool, count: int = _TRIALS) -> list[Outcome]:
        """Outcomes of the first ``count`` trials on the map, or off it, at a length."""
        trials, found = (
            self._on_map if on_map else self._off_map,
            self._outcomes.setdefault((choice, on_map), []),
        )
        if missing := trials[len(found) : count]:
            found += [_localize(trial, LENGTHS[choice]) for trial in missing]
            self._report()
        return found[:count]


def _is_distinct(differences: np.ndarray, errors: float) -> bool:
    """Whether the mean of ``differences`` (n,) is so many standard errors from zero."""
    return abs(differences.mean()) > errors * differences.std() / math.sqrt(len(differences))


def by_chance(trials: int) -> int:
    """False claims in so many trials that the threshold of convergence explains.

    More of them would come in one of twenty scans, where each claim is wrong as often as it concedes.
    """
    wrong, total, claims = 1.0 - Configuration().convergence_probability, 0.0, -1
    while total < 0.95:
        claims += 1
        total += math.comb(trials, claims) * wrong**claims * (1.0 - wrong) ** (trials - claims)
    return claims


def _held_out(scan: Scan, tracks: Tracks) -> list[_HeldOut]:
    """Sweeps that are spread across the scan."""
    positions, strain = scan.positions_on(tracks.scene), scan.strain_on(tracks.scene)
    order = _across(tracks)
    inner = order[1:-1] if len(order) > 4 else order  # the outermost lie beside the map of the others
    found = []
    for place in evenly(len(inner), _SWEEPS):
        track = int(inner[place])
        number = int(scan.sweep_numbers[track])  # others may have been dropped before it
        own = scan.sweep == number
        found.append(_HeldOut(number, track, positions[own], strain[own]))
    return found


def _turns(sweeps: int, rng: np.random.Generator) -> list[tuple[int, int]]:
    """For each trial which of the ``sweeps`` is localized, and in which of two ways, each in turn."""
    order = rng.permutation(sweeps)
    numbers = [divmod(trial, sweeps) for trial in range(_TRIALS)]
    return [(int(order[which]), (which + again) % 2) for again, which in numbers]


def _trials_on_map(
    model: SweepModel, build: Build, sweeps: Sequence[_HeldOut], rng: np.random.Generator
) -> Iterator[_Trial]:
    """Sweeps from their start or from further on, each on the map without it."""
    tracks, held_out = model.scan.tracks, [sweep.track for sweep in sweeps]
    maps = [
        build(model.part(~np.isin(tracks.number, held_out[first::_MAPS])), tracks.scene)
        for first in range(min(_MAPS, len(sweeps)))
    ]
    for which, begins_late in _turns(len(sweeps), rng):
        begin = rng.uniform(0.15, 0.6) if begins_late else 0.0
        part = _part(sweeps[which], np.arange(len(sweeps[which].positions)), begin, tracks.scene)
        yield _Trial(part, True, maps[which % len(maps)])


def _trials_off_map(
    model: SweepModel, build: Build, sweeps: Sequence[_HeldOut], rng: np.random.Generator
) -> Iterator[_Trial]:
    """Parts of sweeps in one half of the map, each on the other half."""
    tracks = model.scan.tracks
    extent = np.array([np.ptp(tracks.positions[own], axis=0) for own in tracks.slices]) * levers(tracks.scene)
    along = int(np.median(extent, axis=0).argmax())
    middle = 0.5 * float(tracks.positions[:, along].min() + tracks.positions[:, along].max())
    localizers = []
    for side in (False, True):
        kept = (tracks.positions[:, along] > middle) == side
        if kept.any() and not kept.all():
            within = surroundings(tracks.scene, tracks.positions[kept])
            localizers.append((side, build(model.part(kept), within)))
    if not localizers:
        return
    for which, way in _turns(len(sweeps), rng):
        side, localizer = localizers[way % len(localizers)]
        rows = np.flatnonzero((sweeps[which].positions[:, along] > middle) != side)
        begin = rng.uniform(0.0, 0.5)
        if len(rows):
            part = _part(sweeps[which], rows, begin, tracks.scene)
            if len(part.positions) >= _LEAST_STRAINS:
                yield _Trial(part, False, localizer)


def _part(sweep: _HeldOut, rows: np.ndarray, begin: float, scene: Scene) -> _HeldOut:
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


def _localize(trial: _Trial, information_length: float) -> Outcome:
    """Localize a trial, scoring what is published of the truth."""
    localizer, (number, _, positions, _) = trial.localizer, trial.sweep
    scene, radius, motion = localizer.scene, localizer.criteria.radius, MotionModel(localizer.scene)
    localizer.reset()
    localizer.information_length = information_length
    score: list[float] = []
    along: list[tuple[float, np.ndarray]] = []
    right = wrong = converged = False
    travel, away, variance = 0.0, np.zeros(scene.dimension), np.square(scene.extent)
    for count, (row, measurement) in enumerate(trial.measurements, 1):
        belief = localizer.measure(measurement)
        travel += measurement.travel
        away = motion.displacement(positions[row], belief.mean + measurement.pending)
        variance = belief.covariance.diagonal()
        near = trial.on_map and float(np.square(away / radius).sum()) <= 1.0
        right, wrong = localizer.converged and near, wrong or (localizer.converged and not near)
        converged = converged or localizer.converged
        truth = positions[row] - measurement.pending
        if count % _EACH == 0:
            score.append(math.log(max(_probability(trial, truth), _LEAST_PROBABILITY)))
            if trial.on_map:
                along.append((travel, _along_axes(localizer, truth)))
    second_half = [axes for there, axes in along if 2.0 * there >= travel]
    axes = (
        np.mean(second_half, axis=0)
        if second_half
        else np.log(np.full(scene.dimension * trial.on_map, _LEAST_PROBABILITY))
    )
    return Outcome(
        number,
        trial.on_map,
        _mean(score),
        bool(right and not wrong),
        bool(wrong),
        bool(converged),
        tuple(np.abs(away).tolist()),
        tuple(np.sqrt(np.maximum(variance, 0.0)).tolist()),
        tuple(axes.tolist()),
        _place_alike(localizer, truth) if trial.on_map else (),
    )


def _probability(trial: _Trial, truth: np.ndarray) -> float:
    """What the localizer gives to the truth: being on the map and near it, or not being on the map."""
    localizer = trial.localizer
    if not trial.on_map:
        return 1.0 - localizer.explanations.on_map
    states, weights = localizer.hypotheses()
    away = MotionModel(localizer.scene).displacement(truth, states)
    radius, variance = localizer.criteria.radius, localizer.registration_variance
    return localizer.explanations.tracked * probability_within(away, weights, radius, variance)


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
    return np.asarray(np.log(np.maximum(near, _LEAST_PROBABILITY)))


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if values else 0.0


def _ignorance(scene: Scene, radius: np.ndarray) -> tuple[float, tuple[float, ...]]:
    """Logarithms of the fractions of the scene within the ``radius`` (d,) of a place, and of each axis."""
    axes, fraction = scene.dimension, radius / scene.extent
    ball = math.pi ** (0.5 * axes) / math.gamma(0.5 * axes + 1.0)
    whole = min(math.log(ball) + float(np.log(fraction).sum()), 0.0)
    return whole, tuple(np.minimum(np.log(2.0 * fraction), 0.0).tolist())
