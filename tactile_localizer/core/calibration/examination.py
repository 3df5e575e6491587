"""Examination of a scan: which kind of material it is, and what a sweep's strains are worth together.

Both are chosen by how sweeps that are held out are localized on the map without them (:mod:`.trials`). Of the
kinds of material (:mod:`..likelihood.material`) that is taken under which they are localized better.

All strains of a sweep share errors of the map, so a strain is worth less than an independent measurement, and
how much less depends on the material, the sensor and the scan: the learning rate of a generalized posterior
(Bissiri, Holmes and Walker, 2016). It is given as a length, the travel per independent measurement, and
there are two, since there are two questions. What places have in common, as how strong the signal of a sweep
is or how much noise it has, says nothing of which of them it is, but is felt as other material. So a strain
is worth less for whether this is the map (*explanation length*) than for where on it the hand is
(*information length*).

A kind of material is judged by the mean logarithm of the probability that is given to the truth, a proper
scoring rule (Gneiting and Raftery, 2007); a pair of lengths by what a user gets of it: with which the sweeps
that are right at their end have been so on the largest part of their way, while no more claims are wrong, on
the map and off it, than the threshold of convergence concedes. Where an axis is known no better than by
ignorance, both are the longest: nothing that was scanned tells places along it apart.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import chain, zip_longest

import numpy as np

from tactile_localizer.core.calibration.sweep_model import SweepModel
from tactile_localizer.core.calibration.trials import (
    Build,
    HeldOut,
    Outcome,
    Trial,
    held_out,
    trials_off_map,
    trials_on_map,
)
from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Scene

LENGTHS = (0.0017, 0.003, 0.005, 0.0085, 0.015, 0.025, 0.05)
"""Lengths to choose from, m."""
_FIRST = 1
"""Index of the length at which the search begins: it ends near there on most scans, after few trials."""
_LONGEST = len(LENGTHS) - 1, len(LENGTHS) - 1
UNEXAMINED = LENGTHS[len(LENGTHS) // 2]
"""Both lengths where no sweep can be held out, m."""
_TRIALS, _FEW = 48, 12
"""Sweeps, or parts of them, that are localized on the map, and off it: at the lengths that may be the best,
and at others."""
_CLEAR = 4.0
"""Standard errors of the difference of two scores of a few trials beyond which more trials are not needed."""
_CONCEDED = -math.log(Configuration().convergence_probability)
"""Score of a belief that just converges."""
Progress = Callable[[float], None]
_Choice = tuple[int, int]
"""Numbers of the information length and the explanation length in :data:`LENGTHS`."""


@dataclass(frozen=True)
class Examination:
    """What the held-out sweeps of a scan show.

    Parameters
    ----------
    information_length : m of travel per independent measurement of the position
    explanation_length : the same of whether this is the map; both are of :data:`LENGTHS`
    ignorance : score of a uniform belief on the map
    ignorance_axes : (d,) the same along each axis alone
    outcomes : of the sweeps, at these lengths
    scores : of pairs of lengths that were tried, m, in this order: on the map, and on other material
        (``None``: not in all trials)
    """

    information_length: float = UNEXAMINED
    explanation_length: float = UNEXAMINED
    ignorance: float = 0.0
    ignorance_axes: tuple[float, ...] = ()
    outcomes: tuple[Outcome, ...] = ()
    scores: tuple[tuple[float, float, float, float | None], ...] = ()

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
        return float(np.mean([each.score for each in self.on_map])) if self.on_map else self.ignorance

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


def examine(
    scan: Scan, models: Sequence[SweepModel], build: Build, progress: Progress | None = None
) -> tuple[int, Examination]:
    """Choose the model and the lengths under which held-out sweeps are localized best.

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
    sweeps = held_out(scan, tracks, models[0].scan.spacing)
    report = _counting(progress, len(models))
    kinds = [_Kind(model, build, sweeps, report) for model in models]
    best = kinds[0]
    best.climb(0, 1)
    for kind in kinds[1:]:
        kind.choice = best.choice
        if not best.is_clearly_better_than(kind):
            kind.climb(0, 1)
            best = kind.better_of(best)
    best.refine()
    found = best.examination()
    if (found.observed < 0.0).any():
        best.choice = _LONGEST
        found = best.examination()
    return kinds.index(best), found


def examine_position(
    scan: Scan,
    model: SweepModel,
    build: Build,
    explanation_length: float,
    progress: Progress | None = None,
) -> float:
    """Information length, m, under which held-out sweeps are localized best by another model of the position.

    The arguments are those of :func:`examine`, with one ``model``, which explains what the position does not,
    and its length.
    """
    if len(model.scan.tracks) < 2:
        return UNEXAMINED
    report = _counting(progress, 1)
    kind = _Kind(model, build, held_out(scan, model.scan.tracks, model.scan.spacing), report)
    kind.choice = kind.choice[0], LENGTHS.index(explanation_length)
    kind.climb(0)
    return LENGTHS[kind.choice[0]]


def _counting(progress: Progress | None, models: int) -> Callable[[int], None]:
    """Reports the completed fraction after so many more trials; how many there will be is not known."""
    done = 0

    def report(trials: int) -> None:
        nonlocal done
        done += trials
        if progress is not None:
            progress(done / (done + 4.0 * _FEW * models))

    return report


class _Kind:
    """Trials under one model, by lengths.

    Attributes
    ----------
    choice : numbers of the best lengths, of information and of explanation
    """

    def __init__(
        self, model: SweepModel, build: Build, sweeps: Sequence[HeldOut], report: Callable[[int], None]
    ) -> None:
        self.scene, self._report = model.scan.tracks.scene, report
        self._on_map = list(trials_on_map(_TRIALS, model, build, sweeps))
        self._make_off_map = partial(trials_off_map, _TRIALS, model, build, sweeps)
        self.choice: _Choice = _FIRST, _FIRST

    @cached_property
    def _off_map(self) -> list[Trial]:
        return list(self._make_off_map())

    def climb(self, *lengths: int) -> None:
        """Climb to the best score of a few trials by changing the lengths of these numbers together."""
        for step in (-1, 1):
            while (
                min(following := self._changed(step, lengths)) >= 0
                and max(following) < len(LENGTHS)
                and self._scores(following, _FEW).mean() > self._scores(self.choice, _FEW).mean()
            ):
                self.choice = following

    def _changed(self, step: int, lengths: Sequence[int]) -> _Choice:
        information, explanation = (each + step * (n in lengths) for n, each in enumerate(self.choice))
        return information, explanation

    def is_clearly_better_than(self, other: _Kind) -> bool:
        """Whether a few trials, each at its length, leave no doubt."""
        difference = self._scores(self.choice, _FEW) - other._scores(other.choice, _FEW)
        return _is_distinct(difference, _CLEAR) and difference.mean() > 0.0

    def better_of(self, other: _Kind) -> _Kind:
        """The one with the better score, or, where that is open, more trials right at the end, or this one.

        A few trials decide where their scores are far from each other.
        """
        for count, errors in ((_FEW, _CLEAR), (_TRIALS, 1.0)):
            difference = self._scores(self.choice, count) - other._scores(other.choice, count)
            if _is_distinct(difference, errors):
                return self if difference.mean() > 0.0 else other
        right = [sum(each.right for each in kind._outcomes(kind.choice, True)) for kind in (self, other)]
        return self if right[0] >= right[1] else other

    def refine(self) -> None:
        """Choose, by all trials, the lengths with which most is claimed and few claims are false.

        The search begins at the length next below that with the best score. With longer lengths fewer claims
        are false, and a sweep converges later, as a rule: no more is claimed than since it did with shorter
        ones. Where none of a few sweeps is right at its end, the search begins at that length, and both
        lengths are the same.
        """
        last, most = len(LENGTHS), -1.0
        is_any_right = any(each.right for each in self._outcomes(self.choice, True, _FEW))
        shortest = max(self.choice[0] - 1, 0) if is_any_right else self.choice[0]
        for information in range(shortest, last):
            are_few = True
            for explanation in range(information, last if is_any_right else information + 1):
                choice = information, explanation
                if self._claimed_at_most(choice) <= most:
                    break
                if self._passes(choice, most):
                    self.choice, most = choice, self._claimed_at_most(choice)
                elif self._has_false_claims(choice):
                    are_few = False
            if most >= 0.0 and are_few:
                return

    def _passes(self, choice: _Choice, most: float) -> bool:
        """Whether more than ``most`` is claimed and right with two lengths, and few claims are false.

        Until one of these cannot be. First come trials with most false claims at other lengths; then those
        on the map that could claim most and those off it, in turn. Those on it last where nothing is claimed
        yet.
        """
        on_map = sorted(self._on_map, key=lambda each: -_most_claimed(each, choice))
        pairs = zip_longest(on_map, self._off_map) if most >= 0.0 else [(*self._off_map, *on_map)]
        in_turn = filter(None, chain.from_iterable(pairs))
        for trial in sorted(in_turn, key=lambda each: -sum(was.wrong for was in each.outcomes.values())):
            self._localized(choice, trial)
            if self._claimed_at_most(choice) <= most or self._has_false_claims(choice):
                return False
        return True

    def _claimed_at_most(self, choice: _Choice) -> float:
        """Most that can be claimed and right on the map, by trials with these and with shorter lengths."""
        return float(np.mean([_most_claimed(each, choice) for each in self._on_map]))

    def _has_false_claims(self, choice: _Choice) -> bool:
        """Whether more claims are wrong than are conceded: of those on the map, or off it.

        Trials that were not made yet count as right. Off the map each claim is wrong; of material that
        resembles itself nothing is expected there.
        """
        lengths = LENGTHS[choice[0]], LENGTHS[choice[1]]
        on_map, off_map = (
            [trial.outcomes[lengths] for trial in trials if lengths in trial.outcomes]
            for trials in (self._on_map, self._off_map)
        )
        claims = len(self._on_map) - sum(not each.converged for each in on_map)
        if not _are_conceded(on_map, claims):
            return True
        return not (_are_conceded(off_map, len(self._off_map)) or self._resembles_itself)

    @cached_property
    def _resembles_itself(self) -> bool:
        """Whether there are more false claims off the map even in a few trials with the longest lengths."""
        return not _are_conceded(self._outcomes(_LONGEST, False, _FEW), len(self._off_map))

    def examination(self) -> Examination:
        """The examination at the best lengths."""
        ignorance = _ignorance(self.scene, self._on_map[0].localizer.criteria.radius)
        outcomes = self._outcomes(self.choice, True) + self._outcomes(self.choice, False)
        scores: list[tuple[float, float, float, float | None]] = []
        for lengths in sorted({lengths for trial in self._on_map for lengths in trial.outcomes}):
            every, few, off_map = (
                _mean_score(trials, lengths) for trials in (self._on_map, self._on_map[:_FEW], self._off_map)
            )
            if few is not None:
                scores.append((*lengths, few if every is None else every, off_map))
        information, explanation = self.choice
        lengths = LENGTHS[information], LENGTHS[explanation]
        return Examination(*lengths, *ignorance, tuple(outcomes), tuple(scores))

    def _scores(self, choice: _Choice, count: int = _TRIALS) -> np.ndarray:
        """Of the first ``count`` trials on the map at two lengths, (n,)."""
        return np.array([each.score for each in self._outcomes(choice, True, count)])

    def _outcomes(self, choice: _Choice, on_map: bool, count: int = _TRIALS) -> list[Outcome]:
        """Outcomes of the first ``count`` trials on the map, or off it, at two lengths."""
        trials = self._on_map if on_map else self._off_map
        return [self._localized(choice, trial) for trial in trials[:count]]

    def _localized(self, choice: _Choice, trial: Trial) -> Outcome:
        """Outcome of a trial at two lengths."""
        done, (information, explanation) = len(trial.outcomes), choice
        found = trial.localize(LENGTHS[information], LENGTHS[explanation])
        self._report(len(trial.outcomes) - done)
        return found


def _is_distinct(differences: np.ndarray, errors: float) -> bool:
    """Whether the mean of ``differences`` (n,) of scores is so many standard errors from zero.

    What the threshold of convergence concedes is no difference.
    """
    least = errors * differences.std() / math.sqrt(len(differences))
    return abs(differences.mean()) > max(least, _CONCEDED)


def _mean_score(trials: Sequence[Trial], lengths: tuple[float, float]) -> float | None:
    """Mean score with two lengths, m; ``None`` where not all trials were made with them."""
    scores = [each.outcomes[lengths].score for each in trials if lengths in each.outcomes]
    return float(np.mean(scores)) if 0 < len(scores) == len(trials) else None


def _most_claimed(trial: Trial, choice: _Choice) -> float:
    """Most that can be claimed and right in a trial, by how it was localized with these and shorter lengths.

    With longer lengths a sweep converges later, as a rule.
    """
    lengths = LENGTHS[choice[0]], LENGTHS[choice[1]]
    if found := trial.outcomes.get(lengths):
        return found.claimed * found.right
    tried = trial.outcomes.items()
    shorter = [was.since for each, was in tried if each[0] <= lengths[0] and each[1] <= lengths[1]]
    return min(shorter, default=1.0)


def _are_conceded(outcomes: Sequence[Outcome], claims: int) -> bool:
    """Whether no more of them are ever wrong than the threshold of convergence concedes of so many claims."""
    return sum(each.wrong for each in outcomes) <= conceded(claims)


def conceded(claims: int) -> int:
    """False ones among so many claims that the threshold of convergence concedes.

    Not as many as may come by chance: of 96 trials these would be six, and material on which twice as many
    claims are wrong as is said would pass as often as not.
    """
    return round(claims * (1.0 - Configuration().convergence_probability))


def _ignorance(scene: Scene, radius: np.ndarray) -> tuple[float, tuple[float, ...]]:
    """Logarithms of the fractions of the scene within the ``radius`` (d,) of a place, and of each axis."""
    axes, fraction = scene.dimension, radius / scene.extent
    ball = math.pi ** (0.5 * axes) / math.gamma(0.5 * axes + 1.0)
    whole = min(math.log(ball) + float(np.log(fraction).sum()), 0.0)
    return whole, tuple(np.minimum(np.log(2.0 * fraction), 0.0).tolist())
