"""Parameters of the material chosen by data: what localises held-out sweeps best.

The paper specifies S_x and S_z by hand (III-C). Here each candidate is judged by what it is for: every sweep
in turn is left out of the map and localised on it from nowhere by the exact grid filter; the score is the
mean logarithm of the posterior density at the true position, over that of a uniform belief, in nats. The
logarithm is a proper score: a belief that is wrong loses, and so does one that is needlessly wide or falsely
narrow. So the same score chooses the kernel widths and how strongly consecutive strains are tempered, among
the candidates whose 95 % regions held the truth often enough.

Two things are not chosen by the score, because sweeps of the same scan would mislead it. Offsets that drift
from sweep to sweep are alike in sweeps that were scanned one after the other, side by side: they help to find
a sweep of the same scan, and no other. They are removed wherever the scene's region tells what is
featureless. And a held-out sweep lies just in the middle of a gap twice as wide as those of the scan, where
two neighbours alone find it best, and interpolation is at its worst. Strains are interpolated wherever the
sweeps leave gaps.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from tactile_localizer.core.correlation import Correlation
from tactile_localizer.core.credit import NO_CREDIT
from tactile_localizer.core.geometry.motion import MotionModel
from tactile_localizer.core.grid_filter import GridFilter
from tactile_localizer.core.likelihood.base import MeasurementModel
from tactile_localizer.core.likelihood.sum_of_gaussians import SumOfGaussians
from tactile_localizer.core.parameters import ModelParameters
from tactile_localizer.core.scan.between_sweeps import leaves_gaps, with_interpolated_sweeps
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.spacing import base_widths, divided
from tactile_localizer.core.sweep_offset import SweepOffset, knows_offsets
from tactile_localizer.errors import ScanError
from tactile_localizer.scene import Scene

POSITION_FACTORS = (0.18, 0.25, 0.35, 0.5, 0.7, 1.0, 1.4)
"""Shares of the sweeps' spacing, as those below of the sweeps' disagreement. Not wider: leaving a sweep out
doubles the gap that the kernels have to bridge, and asks for kernels too wide for the whole scan."""
STRAIN_FACTORS = (0.25, 0.35, 0.5, 0.7, 1.0, 1.4)
CORRELATIONS: tuple[tuple[float, float | None], ...] = (
    *((length, None) for length in (0.001, 0.002, 0.003)),
    *itertools.product((0.006, 0.01, 0.02), (8.0, 4.0)),
)
"""Travel, m, and change of strain, in kernel widths, that make an independent measurement. Over short travel
what changes counts in any case."""

_NEIGHBOURS = ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))
"""Of a candidate: a width more or less."""
_STEP = 0.001
_LONGEST = 0.06
_SEGMENTS = 12
_MOST_CELLS = 2000
_UNIFORM = 0.01
_HONEST = 0.94
"""Coverage asked of 95 % regions."""
_WHOLE = 0.85
"""What widths are multiplied by for the whole scan, where its sweeps leave gaps: with one left out, kernels
had to bridge a gap twice as wide."""
_PENALTY = 30.0
"""nats a unit of coverage that is missing: a candidate that covers 0.90 has to be 1.2 nats better."""

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Trial:
    """One candidate, its score in nats a strain, and how often its 95 % region held the truth."""

    position_factor: float
    strain_factor: float
    parameters: ModelParameters
    score: float
    coverage: float

    @property
    def merit(self) -> float:
        """The score, less a penalty where the candidate is not honest about its uncertainty."""
        return self.score if self.coverage >= _HONEST else self.score - _PENALTY * (_HONEST - self.coverage)

    @property
    def for_whole_scan(self) -> ModelParameters:
        """The parameters, with widths for a scan from which no sweep is left out."""
        chosen = self.parameters
        if not chosen.interpolate:
            return chosen
        return replace(
            chosen, position_std=_WHOLE * chosen.position_std, strain_std=_WHOLE * chosen.strain_std
        )


@dataclass(frozen=True)
class Segment:
    """A stretch of a held-out sweep: displacements (T, d), travels (T,), strains (T, C), states (T, d).

    ``counted`` (T,) bool: where the belief is judged, which is on the feature.
    """

    displacements: np.ndarray
    travels: np.ndarray
    strain: np.ndarray
    states: np.ndarray
    counted: np.ndarray
    training: Scan

    def interpolated(self, scene: Scene) -> Segment:
        """The same stretch on a map with pairs between the sweeps."""
        return replace(self, training=with_interpolated_sweeps(self.training, scene))


def choose_parameters(scan: Scan, scene: Scene, progress: Progress | None = None) -> ModelParameters:
    """The best of :func:`search` for the whole scan, as the parameters to write into a scene."""
    return best_of(search(scan, scene, progress)).for_whole_scan


def best_of(trials: Sequence[Trial]) -> Trial:
    """The trial of most merit."""
    return max(trials, key=lambda trial: trial.merit)


def search(scan: Scan, scene: Scene, progress: Progress | None = None) -> list[Trial]:
    """Score candidates by ascent from the middle of the factors; returns all that were tried.

    Parameters
    ----------
    scan, scene : the training pairs and what is modelled
    progress : told what is being done and which share of it is done

    Raises
    ------
    ScanError
        No sweep of the scan is long enough to be held out.
    """
    interpolate, offset = leaves_gaps(scan, scene), knows_offsets(scan, scene)
    alike = SweepOffset(scan, scene).removed_from(scan, scene) if offset else scan
    position_std, strain_std = base_widths(alike, scene)
    segments = held_out_segments(scan, scene, offset)
    if interpolate:
        segments = [segment.interpolated(scene) for segment in segments]
    trials: dict[tuple[int, int], list[Trial]] = {}
    best = POSITION_FACTORS.index(1.0), STRAIN_FACTORS.index(1.0)
    expected = 8

    def score(place: tuple[int, int]) -> float:
        if place not in trials:
            if progress is not None:
                progress("choosing kernel widths by leaving sweeps out", min(len(trials) / expected, 0.99))
            factors = POSITION_FACTORS[place[0]], STRAIN_FACTORS[place[1]]
            widths = position_std * factors[0], strain_std * factors[1]
            trials[place] = _evaluate(segments, scene, factors, widths, (interpolate, offset))
        return max(trial.merit for trial in trials[place])

    while True:
        around = [
            (best[0] + i, best[1] + j)
            for i, j in _NEIGHBOURS
            if 0 <= best[0] + i < len(POSITION_FACTORS) and 0 <= best[1] + j < len(STRAIN_FACTORS)
        ]
        leader = max(around, key=score)
        if score(leader) <= score(best):
            break
        best = leader
    if progress is not None:
        progress("choosing kernel widths by leaving sweeps out", 1.0)
    return list(itertools.chain.from_iterable(trials.values()))


def held_out_segments(scan: Scan, scene: Scene, offset: bool = False) -> list[Segment]:
    """Stretches of up to 60 mm of sweeps, each with the scan without its sweep, spread over the scan.

    Parameters
    ----------
    scan, scene : the training pairs and what is modelled
    offset : remove the sweeps' offsets, that of a stretch as it is learned along it

    Raises
    ------
    ScanError
        No sweep is long enough.
    """
    motion = MotionModel(scene)
    sweep = divided(scan.sweep)
    columns, channels = scene.columns(scan.axes), scene.channels(scan.phalanges, scan.channels)
    numbers = np.unique(sweep)
    per_sweep = max(1, round(_SEGMENTS / len(numbers)))
    chosen = numbers[np.unique(np.linspace(0, len(numbers) - 1, _SEGMENTS).astype(int))]
    segments = []
    for number in chosen:
        rows = np.flatnonzero(sweep == number)
        states = scan.states[rows][:, columns]
        training = scan.select(sweep != number)
        learned = SweepOffset(training, scene) if offset else None
        if learned is not None:
            training = learned.removed_from(training, scene)
        travelled = np.concatenate(
            [[0.0], np.cumsum([motion.travel(step) for step in np.diff(states, axis=0)])]
        )
        for start in np.linspace(0.0, max(travelled[-1] - _LONGEST, 0.0), per_sweep):
            marks = np.arange(start, min(start + _LONGEST, travelled[-1]), _STEP)
            index = np.unique(np.searchsorted(travelled, marks))
            if len(index) < 10:
                continue
            displacements = np.diff(states[index], axis=0, prepend=states[index[:1]])
            travels = np.diff(travelled[index], prepend=travelled[index[0]])
            counted = scene.on_feature(states[index])
            strain = scan.strain[rows[index]][:, channels]
            if learned is not None:
                strain = _corrected(strain, travels, learned)
            segments.append(Segment(displacements, travels, strain, states[index], counted, training))
    if not segments:
        raise ScanError(
            f"scan: expected a sweep of at least {10 * _STEP * 1e3:.0f} mm to choose parameters by, "
            "found none; give position_std, strain_std and correlation_length in the scene"
        )
    return segments


def _corrected(strain: np.ndarray, travels: np.ndarray, offset: SweepOffset) -> np.ndarray:
    """Strains (T, C) of a stretch without its offset, as the localizer learns it on the way."""
    offset.reset()
    present = np.ones(offset.layout.phalanges, dtype=bool)
    steps = zip(strain, np.maximum(travels, _STEP).tolist(), strict=True)
    return np.stack([offset.corrected(each, present, travel) for each, travel in steps])


class _Recorded(MeasurementModel):
    """Repeats what another model said, update for update."""

    def __init__(self, maps: list[np.ndarray]) -> None:
        self._maps = iter(maps)

    def log_likelihood(
        self, states: np.ndarray, strain: np.ndarray, present: np.ndarray | None = None
    ) -> np.ndarray:
        raise NotImplementedError("the grid filter asks for whole axes")

    def log_likelihood_on(
        self, axes: list[np.ndarray], strain: np.ndarray, present: np.ndarray | None = None
    ) -> np.ndarray:
        return next(self._maps)


def _evaluate(
    segments: list[Segment],
    scene: Scene,
    factors: tuple[float, float],
    widths: tuple[np.ndarray, np.ndarray],
    choices: tuple[bool, bool],
) -> list[Trial]:
    """Scores of one pair of widths with every correlation; ``choices``: interpolate, sweep_offset."""
    position_std, strain_std = widths
    extent = scene.upper - scene.lower
    cell = np.maximum(0.25 * position_std, extent * _MOST_CELLS ** (-1.0 / scene.dimension))
    results: dict[tuple[float, float | None], list[np.ndarray]] = {each: [] for each in CORRELATIONS}
    for segment in segments:
        model = SumOfGaussians(segment.training, scene, position_std, strain_std, precision="float32")
        recorder = _Recorder(model)
        for length, change in CORRELATIONS:
            source = recorder if not recorder.maps else _Recorded(recorder.maps)
            correlation = Correlation(length, change, strain_std, scene.layout)
            grid = GridFilter(scene, source, cell)
            results[length, change].append(_localize(segment, scene, grid, correlation))
    trials = []
    for (length, change), parts in results.items():
        score, coverage = np.concatenate(parts).mean(axis=0)
        parameters = ModelParameters(position_std, strain_std, length, change, *choices)
        trials.append(Trial(*factors, parameters, float(score), float(coverage)))
    return trials


class _Recorder(_Recorded):
    """Passes on what the model says and keeps it."""

    def __init__(self, model: SumOfGaussians) -> None:
        super().__init__([])
        self.maps: list[np.ndarray] = []
        self._model = model

    def log_likelihood_on(
        self, axes: list[np.ndarray], strain: np.ndarray, present: np.ndarray | None = None
    ) -> np.ndarray:
        self.maps.append(self._model.log_likelihood_on(axes, strain, present))
        return self.maps[-1]


def _localize(segment: Segment, scene: Scene, grid: GridFilter, correlation: Correlation) -> np.ndarray:
    """After each strain, the score of the belief and whether its 95 % region holds the truth: (T, 2)."""
    present = np.ones(len(scene.phalanges), dtype=bool)
    radius = float(chi2.ppf(0.95, segment.states.shape[1]))
    results = np.empty((len(segment.strain), 2))
    for t, strain in enumerate(segment.strain):
        travel = float(segment.travels[t])
        if t:
            grid.predict(segment.displacements[t], travel)
        grid.update(strain, present, correlation.share(strain, present, max(travel, _STEP)), NO_CREDIT)
        density = grid.relative_density(segment.states[t])
        belief = grid.belief()
        error = segment.states[t] - belief.mean
        covered = error @ np.linalg.solve(belief.covariance, error) <= radius
        results[t] = np.log((1.0 - _UNIFORM) * density + _UNIFORM), covered
    return results[segment.counted]
