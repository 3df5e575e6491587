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

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from tactile_localizer.core.calibration.sweep_model import SweepModel
from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.geometry.motion import MotionModel, levers
from tactile_localizer.core.geometry.surroundings import surroundings
from tactile_localizer.core.hypotheses.convergence import probability_within
from tactile_localizer.core.localizer import Localizer
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.tracks import Tracks, evenly
from tactile_localizer.scene import Scene

LENGTHS = (0.0017, 0.003, 0.005, 0.0085, 0.015, 0.025, 0.05)
"""Information lengths to choose from, m; the search begins in the middle."""
UNEXAMINED = LENGTHS[len(LENGTHS) // 2]
"""Information length where no sweep can be held out, m."""
_TRIALS = 12
"""Sweeps, or parts of them, that are localized on the map, and off it."""
_MAPS = 6
"""Maps without a sweep; of more sweeps, two that are far from each other are left out of one."""
_LONGEST = 0.1
"""m of a sweep that are localized."""
_LEAST_STRAINS = 10
"""Strains of a part of a sweep that is localized."""
_EACH = 4
"""Measurement updates from one that is scored to the next."""
_LEAST_PROBABILITY = 0.005
"""Least probability that is scored: a belief that gives less to the truth is wrong, how much less says
nothing of others."""
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
    right, wrong, converged : converged and right at its end; ever converged and wrong; ever converged
    error : (d,) distance of the last estimate from the truth along each axis, m (yaw: rad)
    spread : (d,) its standard deviation along each axis without the registration error, m (yaw: rad)
    axes : (d,) score along each axis alone, over the second half of the way; empty if not on the map
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


@dataclass(frozen=True)
class Examination:
    """What the held-out sweeps of a scan show.

    Parameters
    ----------
    information_length : travel per independent measurement, m
    ignorance : score of a uniform belief on the map
    ignorance_axes : (d,) the same along each axis alone
    outcomes : of the sweeps, at that length
    scores : of the lengths that were tried, m: on the map, and on other material
    """

    information_length: float = UNEXAMINED
    ignorance: float = 0.0
    ignorance_axes: tuple[float, ...] = ()
    outcomes: tuple[Outcome, ...] = ()
    scores: tuple[tuple[float, float, float], ...] = ()

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


class _Trial(NamedTuple):
    """A held-out sweep, or a part of it, and a localizer that does not know it."""

    sweep: _HeldOut
    on_map: bool
    localizer: Localizer


def examine(scan: Scan, model: SweepModel, build: Build, progress: Progress | None = None) -> Examination:
    """Choose the information length with the best score on the map, among those without many false claims.

    Parameters
    ----------
    scan : whose sweeps are held out
    model : learned from all of it
    build : makes a localizer from a part of the model, over the scene in which that part lies
    progress : called with the completed fraction
    """
    scene = model.scan.tracks.scene
    if len(model.scan.tracks) < 2:
        return Examination()
    sweeps, rng = _held_out(scan, model.scan.tracks), np.random.default_rng(0)
    trials = [*_trials_on_map(model, build, sweeps, rng), *_trials_off_map(model, build, sweeps, rng)]
    tried: dict[int, list[Outcome]] = {}

    def merit(choice: int) -> tuple[int, float]:
        if choice not in tried:
            tried[choice] = [_localize(trial, LENGTHS[choice]) for trial in trials]
            if progress is not None:
                progress(min(len(tried) / 5.0, 1.0))
        claims = sum(each.wrong for each in tried[choice])
        return min(by_chance(len(trials)) - claims, 0), _scores(tried[choice])[0]

    best = LENGTHS.index(UNEXAMINED)
    merit(best)
    for step in (-1, 1):
        while 0 <= best + step < len(LENGTHS) and merit(best + step) > merit(best):
            best += step
    ignorance = _ignorance(scene, trials[0].localizer.criteria.radius)

    def examination(choice: int) -> Examination:
        scores = tuple((LENGTHS[each], *_scores(tried[each])) for each in sorted(tried))
        return Examination(LENGTHS[choice], *ignorance, tuple(tried[choice]), scores)

    found = examination(best)
    if (found.observed < 0.0).any():
        longest = len(LENGTHS) - 1
        merit(longest)
        found = examination(longest)
    return found


def by_chance(trials: int) -> int:
    """False claims in so many trials that the threshold of convergence concedes."""
    return math.ceil(trials * (1.0 - Configuration().convergence_probability))


def _held_out(scan: Scan, tracks: Tracks) -> list[_HeldOut]:
    """Sweeps that are spread across the scan."""
    positions, strain = scan.positions_on(tracks.scene), scan.strain_on(tracks.scene)
    order = _across(tracks)
    inner = order[1:-1] if len(order) > 4 else order  # the outermost lie beside the map of the others
    found = []
    for place in evenly(len(inner), _TRIALS):
        track = int(inner[place])
        number = int(scan.sweep_numbers[track])  # others may have been dropped before it
        own = scan.sweep == number
        found.append(_HeldOut(number, track, positions[own], strain[own]))
    return found


def _turns(sweeps: int) -> list[tuple[int, int]]:
    """For each trial which of the ``sweeps`` is localized, and in which of two ways, each in turn."""
    numbers = [divmod(trial, sweeps) for trial in range(_TRIALS)]
    return [(which, (which + again) % 2) for again, which in numbers]


def _trials_on_map(
    model: SweepModel, build: Build, sweeps: Sequence[_HeldOut], rng: np.random.Generator
) -> Iterator[_Trial]:
    """Sweeps from their start or from further on, each on the map without it."""
    tracks, held_out = model.scan.tracks, [sweep.track for sweep in sweeps]
    maps = [
        build(model.part(~np.isin(tracks.number, held_out[first::_MAPS])), tracks.scene)
        for first in range(min(_MAPS, len(sweeps)))
    ]
    for which, begins_late in _turns(len(sweeps)):
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
    for side in (0, 1):
        kept = (tracks.positions[:, along] > middle) == bool(side)
        if kept.all() or not kept.any():
            continue
        localizer = build(model.part(kept), surroundings(tracks.scene, tracks.positions[kept]))
        for which, of_side in _turns(len(sweeps)):
            rows = np.flatnonzero((sweeps[which].positions[:, along] > middle) != bool(side))
            if of_side == side and len(rows):
                part = _part(sweeps[which], rows, rng.uniform(0.0, 0.5), tracks.scene)
                if len(part.positions) >= _LEAST_STRAINS:
                    yield _Trial(part, False, localizer)


def _part(sweep: _HeldOut, rows: np.ndarray, begin: float, scene: Scene) -> _HeldOut:
    """At most :data:`_LONGEST` metres of a sweep: of ``rows`` (n,), those after a part ``begin`` of the way.

    A hand that rests, as after a sweep until it is ended, is on no way.
    """
    motion, positions = MotionModel(scene), sweep.positions[rows]
    farthest = np.maximum.accumulate(motion.travels(motion.displacement(positions[0], positions)))
    on_the_way = np.flatnonzero(np.diff(farthest, prepend=-1.0) > 0.0)
    rows = rows[on_the_way[int(begin * len(on_the_way))] :]
    rows = rows[_travels(sweep.positions[rows], scene).cumsum() <= _LONGEST]
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
    """Localize a trial with the noise of odometry, scoring what is published of the truth."""
    localizer, (number, track, positions, strains) = trial.localizer, trial.sweep
    scene, radius = localizer.scene, localizer.criteria.radius
    motion = MotionModel(scene)
    localizer.reset()
    localizer.information_length = information_length
    rng = np.random.default_rng(track)
    steps = rng.standard_normal(positions.shape) * scene.motion_std
    odometry = positions + np.cumsum(steps * np.sqrt(_travels(positions, scene))[:, None], axis=0)
    score: list[float] = []
    along: list[tuple[float, np.ndarray]] = []
    right = wrong = converged = False
    updates, away, variance = 0, np.zeros(scene.dimension), np.square(scene.extent)
    for row, (place, strain) in enumerate(zip(odometry, strains, strict=True)):
        estimate = localizer.update((1 + row) * _PERIOD_NS, place, strain)
        away = motion.displacement(positions[row], estimate.mean)
        variance = estimate.covariance.diagonal() - localizer.registration_variance
        near = trial.on_map and float(np.square(away / radius).sum()) <= 1.0
        right, wrong = estimate.converged and near, wrong or (estimate.converged and not near)
        converged = converged or estimate.converged
        updates += estimate.updated
        if estimate.updated and updates % _EACH == 0:
            score.append(math.log(max(_probability(trial, positions[row]), _LEAST_PROBABILITY)))
            if trial.on_map:
                along.append((estimate.travel, _along_axes(localizer, positions[row])))
    second_half = [axes for travel, axes in along if 2.0 * travel >= estimate.travel]
    axes = (
        np.mean(second_half, axis=0)
        if second_half
        else np.log(np.full(scene.dimension * trial.on_map, _LEAST_PROBABILITY))
    )
    return Outcome(
        number,
        trial.on_map,
        _mean(score),
        bool(right),
        bool(wrong),
        bool(converged),
        tuple(np.abs(away).tolist()),
        tuple(np.sqrt(np.maximum(variance, 0.0)).tolist()),
        tuple(axes.tolist()),
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


def _along_axes(localizer: Localizer, truth: np.ndarray) -> np.ndarray:
    """Logarithms (d,) of the belief within the radius of the truth along each axis alone."""
    states, weights = localizer.hypotheses()
    away = MotionModel(localizer.scene).displacement(truth, states)
    near = weights @ (np.abs(away) <= localizer.criteria.radius)
    return np.asarray(np.log(np.maximum(near, _LEAST_PROBABILITY)))


def _scores(outcomes: Sequence[Outcome]) -> tuple[float, float]:
    """Mean score on the map, and on other material."""
    by_truth = ([each.score for each in outcomes if each.on_map is on_map] for on_map in (True, False))
    on_map, off_map = (_mean(each) for each in by_truth)
    return on_map, off_map


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if values else 0.0


def _ignorance(scene: Scene, radius: np.ndarray) -> tuple[float, tuple[float, ...]]:
    """Logarithms of the fractions of the scene within the ``radius`` (d,) of a place, and of each axis."""
    axes, fraction = scene.dimension, radius / scene.extent
    ball = math.pi ** (0.5 * axes) / math.gamma(0.5 * axes + 1.0)
    whole = min(math.log(ball) + float(np.log(fraction).sum()), 0.0)
    return whole, tuple(np.minimum(np.log(2.0 * fraction), 0.0).tolist())
