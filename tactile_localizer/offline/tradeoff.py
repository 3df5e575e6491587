"""Accuracy against computing time of several configurations on the same recordings.

Each candidate is replayed on each recording, in processes of this machine or on a dask cluster. Times are
processor times of one thread, so that candidates may run beside each other.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import joblib
import numpy as np

from tactile_localizer.core.calibration.held_out import Calibration
from tactile_localizer.core.configuration import MODELS, SWEEP_MIXTURE, Configuration
from tactile_localizer.core.factory import build_localizer, learn
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import ParameterError
from tactile_localizer.io.configuration_file import PRESETS, load_configuration
from tactile_localizer.io.recording import Recording
from tactile_localizer.offline.metrics import (
    SQUARED_95,
    position_error,
    squared_mahalanobis,
    timing,
    with_contact,
)
from tactile_localizer.offline.replay import Progress, ReplayedSweep, replay
from tactile_localizer.scene import Scene

DEFAULT = "default"
"""Name of the default configuration beside those of the presets."""

BINS = 40
"""Bins along the sweeps in which errors and variances are averaged."""

_CLUSTER_TIMEOUT_S = 5
_QUANTILE = 1.96


@dataclass(frozen=True)
class Candidate:
    """Configuration to measure, and its name in tables and pictures."""

    name: str
    configuration: Configuration

    @property
    def changes(self) -> dict[str, Any]:
        """Values of the configuration that differ from the defaults, by name."""
        default = asdict(Configuration())
        return {name: value for name, value in asdict(self.configuration).items() if value != default[name]}


@dataclass(frozen=True)
class Outcome:
    """A candidate on the sweeps of one recording.

    Parameters
    ----------
    error : (S,) mean error of each sweep from contact to the feature's end, over the whole sweep where no
        contact is known, m
    coverage : (S,) fraction of the same estimates whose 95 % region contains the truth
    converged : (S,) bool, whether the sweep converged
    error_along, trace_along : (BINS,) mean error, m, and trace of the covariance, m², in bins along the
        sweep axis; NaN where no sweep has been
    timing : computing times, from :func:`~tactile_localizer.offline.metrics.timing`
    """

    error: np.ndarray
    coverage: np.ndarray
    converged: np.ndarray
    error_along: np.ndarray
    trace_along: np.ndarray
    timing: dict[str, float]


@dataclass(frozen=True)
class Trade:
    """Accuracy and cost of a candidate, over all recordings; ``outcomes`` has one for each."""

    candidate: Candidate
    outcomes: tuple[Outcome, ...]

    @cached_property
    def error(self) -> float:
        """Mean error over the sweeps, m."""
        return float(np.nanmean(self._sweeps("error")))

    @property
    def error_half_width(self) -> float:
        """Half width of the 95 % confidence interval of the mean error, m."""
        errors = self._sweeps("error")
        errors = errors[np.isfinite(errors)]
        return float(_QUANTILE * errors.std(ddof=1) / np.sqrt(len(errors))) if len(errors) > 1 else np.nan

    @property
    def coverage(self) -> float:
        """Mean coverage of the 95 % region over the sweeps."""
        return float(np.nanmean(self._sweeps("coverage")))

    @property
    def converged(self) -> float:
        """Fraction of the sweeps that converged."""
        return float(np.mean(self._sweeps("converged")))

    @property
    def update_us(self) -> float:
        """Median processor time of a measurement update, µs."""
        return self._time("update_median_us")

    @property
    def update_p99_us(self) -> float:
        """99th percentile of the processor time of a measurement update, µs."""
        return self._time("update_p99_us")

    @property
    def us_per_mm(self) -> float:
        """Processor time per millimetre of travel, µs."""
        return self._time("us_per_mm")

    def _sweeps(self, name: str) -> np.ndarray:
        return np.concatenate([getattr(outcome, name) for outcome in self.outcomes])

    def _time(self, name: str) -> float:
        return float(np.mean([outcome.timing[name] for outcome in self.outcomes]))


def candidates() -> list[Candidate]:
    """Default, presets, and configurations that vary model, filter, cell, particles and update distance."""
    default = Configuration()
    particle = replace(default, filter="particle")
    varied: dict[str, Configuration] = {name: named_configuration(name) for name in (DEFAULT, *PRESETS)}
    for step in (0.0005, 0.001, 0.0015, 0.003):
        for cell in (0.15, 0.3, 0.45, 0.6, 1.0):
            varied[f"cell {cell:g}, {step * 1e3:g} mm"] = replace(default, cell=cell, update_distance=step)
        for particles in (75, 300, 1000):
            varied[f"{particles} particles, {step * 1e3:g} mm"] = replace(
                particle, particles=particles, update_distance=step
            )
    for model in MODELS:
        if model != SWEEP_MIXTURE:
            varied[f"{model}, {particle.particles} particles"] = replace(particle, model=model)
    names: dict[Configuration, str] = {}
    for name, configuration in varied.items():
        names.setdefault(configuration, name)
    return [Candidate(name, configuration) for configuration, name in names.items()]


def named_configuration(name: str) -> Configuration:
    """The default, a preset, or a configuration file.

    Raises
    ------
    ParameterError
        No such file or preset, or an invalid value.
    """
    return load_configuration(None if name == DEFAULT else name)


def trade(
    scan: Scan,
    scene: Scene,
    recordings: Sequence[Recording],
    measured: Sequence[Candidate],
    *,
    seed: int = 0,
    jobs: int = 1,
    cluster: str | None = None,
    progress: Progress | None = None,
) -> list[Trade]:
    """Replay every candidate on every recording.

    Parameters
    ----------
    scan, scene : training pairs and scene of the map
    recordings : recordings with known truth, whose positions are odometry
    measured : configurations to compare
    seed : seed of the particle filters
    jobs : processes on this machine; -1: one per core
    cluster : address of a dask scheduler to use instead
    progress : called with a description of the work and the completed fraction

    Raises
    ------
    ParameterError
        A recording without truth, an invalid number of jobs, or a cluster that cannot be reached.
    """
    for recording in recordings:
        if any(sweep.truth is None for sweep in recording.sweeps):
            raise ParameterError(f"{recording.source}: expected true positions, found none")
    if jobs < 1 and jobs != -1:
        raise ParameterError(f"jobs: expected at least 1, or -1 for one per core, got {jobs}")
    calibration = learn(scan, scene, progress)
    exact = build_localizer(
        scan, scene, Configuration(), np.random.default_rng(seed), calibration=calibration
    )
    marked = [with_contact(recording, scene, exact.model.map) for recording in recordings]
    calls = [
        joblib.delayed(measure)(scan, scene, recording, candidate.configuration, calibration, seed)
        for candidate in measured
        for recording in marked
    ]
    outcomes: list[Outcome] = []
    with _workers(jobs, cluster):
        for outcome in joblib.Parallel(return_as="generator", batch_size=1)(calls):
            outcomes.append(outcome)
            if progress is not None:
                progress("replaying", len(outcomes) / len(calls))
    n = len(recordings)
    return [
        Trade(candidate, tuple(outcomes[index * n : (index + 1) * n]))
        for index, candidate in enumerate(measured)
    ]


def measure(
    scan: Scan,
    scene: Scene,
    recording: Recording,
    configuration: Configuration,
    calibration: Calibration,
    seed: int,
) -> Outcome:
    """Outcome of one configuration on one recording."""
    rng = np.random.default_rng(seed)
    localizer = build_localizer(scan, scene, configuration, rng, calibration=calibration)
    sweeps = [sweep for sweep in replay(localizer, recording, clock=time.thread_time) if len(sweep)]
    has_contact = any(sweep.contact[0] >= 0 for sweep in sweeps)
    kept = [sweep.on_contact if has_contact else np.ones(len(sweep), dtype=bool) for sweep in sweeps]
    errors = [position_error(scene, sweep) for sweep in sweeps]
    inside = [squared_mahalanobis(scene, sweep) <= SQUARED_95[scene.dimension] for sweep in sweeps]
    return Outcome(
        error=_means(errors, kept),
        coverage=_means(inside, kept),
        converged=np.array([sweep.converged.any() for sweep in sweeps]),
        error_along=_along(scene, sweeps, np.concatenate(errors)),
        trace_along=_along(scene, sweeps, np.concatenate([sweep.trace for sweep in sweeps])),
        timing=timing(sweeps),
    )


def sweep_axis(scene: Scene, truth: np.ndarray) -> int:
    """Index of the axis on which true positions (n, d) span most of the bounds."""
    return int(np.argmax(np.ptp(truth, axis=0) / scene.extent))


def bin_centres(scene: Scene, axis: int) -> np.ndarray:
    """Centres of the bins along an axis, (BINS,) m."""
    edges = np.linspace(scene.lower[axis], scene.upper[axis], BINS + 1)
    return (edges[:-1] + edges[1:]) / 2


def pareto_front(trades: Sequence[Trade]) -> list[Trade]:
    """Trades that no other one beats in both error and time per millimetre, from fast to accurate."""
    front: list[Trade] = []
    for one in sorted(trades, key=lambda trade: (trade.us_per_mm, trade.error)):
        if not front or one.error < front[-1].error:
            front.append(one)
    return front


def within_budget(trades: Sequence[Trade], budget_us: float) -> Trade | None:
    """Most accurate trade with a median update time of at most ``budget_us``."""
    affordable = (one for one in trades if one.update_us <= budget_us)
    return min(affordable, key=lambda one: one.error, default=None)


def for_target(trades: Sequence[Trade], target_m: float) -> Trade | None:
    """Trade of least time per millimetre with a mean error of at most ``target_m``."""
    accurate = (one for one in trades if one.error <= target_m)
    return min(accurate, key=lambda one: one.us_per_mm, default=None)


def _means(values: Sequence[np.ndarray], kept: Sequence[np.ndarray]) -> np.ndarray:
    """Mean of the kept values of each sweep; NaN where none is kept."""
    return np.array(
        [own[keep].mean() if keep.any() else np.nan for own, keep in zip(values, kept, strict=True)]
    )


def _along(scene: Scene, sweeps: Sequence[ReplayedSweep], values: np.ndarray) -> np.ndarray:
    """Means of values in the bins of the sweep axis, (BINS,)."""
    truth = np.concatenate([sweep.truth for sweep in sweeps if sweep.truth is not None])
    axis = sweep_axis(scene, truth)
    index = np.floor((truth[:, axis] - scene.lower[axis]) / scene.extent[axis] * BINS).astype(int)
    within = (index >= 0) & (index < BINS)
    count = np.bincount(index[within], minlength=BINS)
    total = np.bincount(index[within], values[within], minlength=BINS)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


@contextmanager
def _workers(jobs: int, cluster: str | None) -> Iterator[None]:
    """Context in which joblib uses processes of this machine, or a dask cluster."""
    if cluster is None:
        with joblib.parallel_config("loky", n_jobs=jobs, inner_max_num_threads=1):
            yield
        return
    try:
        from distributed import Client
    except ImportError:
        raise ParameterError("--cluster: expected dask[distributed], which is not installed") from None
    try:
        client = Client(cluster, timeout=_CLUSTER_TIMEOUT_S)
    except (OSError, ValueError) as error:
        raise ParameterError(
            f"--cluster {cluster}: expected a dask scheduler, {' '.join(str(error).split())}"
        ) from None
    with client, joblib.parallel_config("dask", client=client):
        yield
