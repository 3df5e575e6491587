"""Accuracy against computing time of many configurations: Pareto front and choice."""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from evaluation.comparison import Method, Trial, evaluate, trials
from evaluation.conditions import Condition
from evaluation.confidence_interval import Interval
from evaluation.jobs import Progress, Workers, run_tasks
from tactile_localizer.core.configuration import Configuration
from tactile_localizer.io.configuration_file import PRESETS, load_configuration
from tactile_localizer.offline.metrics import timing
from tactile_localizer.offline.replay import replay

_MEMORY_SAMPLES = 200
"""Number of samples from the start of a sweep for which memory is measured."""

_TIMED_SWEEPS = 2
_PASSES = 3
"""Repetitions of the timed sweeps."""

DEFAULT = "default"
"""Name of the default configuration beside those of the presets."""

BUDGETS_US = (100.0, 200.0, 300.0, 500.0, 1000.0)
"""Budgets for a measurement update and for a millimetre of travel in the table of budgets, µs."""


@dataclass(frozen=True)
class Candidate:
    """Configuration to measure.

    Parameters
    ----------
    configuration : configuration of the localizer
    preset : name of the preset, or :data:`DEFAULT`; empty for other configurations
    """

    configuration: Configuration
    preset: str = ""

    @property
    def changes(self) -> dict[str, Any]:
        """Fields of the configuration that differ from the defaults."""
        default = asdict(Configuration())
        return {k: v for k, v in asdict(self.configuration).items() if v != default[k]}

    @property
    def name(self) -> str:
        """Short description of the configuration."""
        own, default = self.configuration, Configuration()
        parts = [f"{self.preset}:"] if self.preset else []
        parts += [own.model, f"grid {own.cell:g}" if own.filter == "grid" else f"particle {own.particles}"]
        step = own.update_distance
        parts += [f"{step * 1e3:g} mm"] if step != default.update_distance else []
        return " ".join(parts)


@dataclass(frozen=True)
class Trade:
    """Accuracy and cost of a candidate.

    Parameters
    ----------
    candidate : the configuration
    error : mean error from contact to the feature's end (over the sweep if contact is not known), m
    coverage : fraction of the estimates whose 95 % region contains the truth
    update_us, update_p99_us : processor time of a measurement update, median and 99th percentile, µs
    us_per_mm : processor time per millimetre of travel, µs
    memory_mb : peak memory without the scan, MB
    """

    candidate: Candidate
    error: Interval
    coverage: float
    update_us: float
    update_p99_us: float
    us_per_mm: float
    memory_mb: float


def candidates() -> list[Candidate]:
    """Candidates with different models, filters, particles, cells and travel between updates."""
    found = [Candidate(Configuration(), preset=DEFAULT)]
    found += [Candidate(load_configuration(preset), preset=preset) for preset in PRESETS]
    found += [Candidate(configuration) for configuration in _configurations()]
    unique: dict[Configuration, Candidate] = {}
    for candidate in found:
        unique.setdefault(candidate.configuration, candidate)
    return list(unique.values())


def _configurations() -> Iterator[Configuration]:
    grid = Configuration()
    particle = replace(grid, filter="particle")
    for step in (0.0005, 0.001, 0.002, 0.003):
        for cell in (0.15, 0.3, 0.6, 1.0):
            yield replace(grid, cell=cell, update_distance=step)
        for particles in (75, 150, 300, 1000):
            yield replace(particle, particles=particles, update_distance=step)
    few = replace(particle, model="sum_of_gaussians", particles=75)
    yield few
    for model in ("sum_of_gaussians", "featureless"):
        yield replace(grid, model=model)
    for model in ("featureless", "gaussian", "gaussian_independent"):
        yield replace(particle, model=model)


def trade(
    conditions: Sequence[Condition],
    measured: Sequence[Candidate],
    folder: Path,
    workers: Workers,
    progress: Progress | None = None,
) -> list[Trade]:
    """Measure accuracy and cost of every candidate on every condition; stored results are reused.

    Raises
    ------
    ParameterError
        Unavailable workers.
    """
    methods = [Method(str(number), one.configuration) for number, one in enumerate(measured)]
    results = evaluate(conditions, methods, folder, workers, progress)
    first = [own[0] for own in trials(conditions, methods, folder, workers, progress)]
    # One at a time: concurrent tasks would slow each other down.
    tasks = [trial.task(cost) for trial in first]
    costs = run_tasks(tasks, folder, Workers(), progress, "measuring time and memory")
    quantity, _ = results.compared_error()
    return [
        Trade(
            one,
            results.interval(method.name, quantity) or Interval(np.nan, np.nan, np.nan),
            coverage=float(np.nanmean(results.values(method.name, "coverage"))),
            update_us=own["timing"]["update_median_us"],
            update_p99_us=own["timing"]["update_p99_us"],
            us_per_mm=own["timing"]["us_per_mm"],
            memory_mb=own["peak_bytes"] / 1e6,
        )
        for one, method, own in zip(measured, methods, costs, strict=True)
    ]


def cost(trial: Trial) -> dict[str, Any]:
    """Cost of a localizer: processor time of one thread, and peak memory without the scan.

    The time of each sample is the minimum over several repetitions, which removes the load of other
    processes.
    """
    material = trial.condition.load()
    few = replace(material.recording, sweeps=material.recording.sweeps[:_TIMED_SWEEPS])
    localizer = trial.localizer(material)
    passes = [replay(localizer, few, clock=time.thread_time) for _ in range(_PASSES)]
    least = [
        replace(tracks[0], seconds=np.min([track.seconds for track in tracks], axis=0))
        for tracks in zip(*passes, strict=True)
    ]
    # The belief is widest at the start and takes the most memory.
    start = replace(few, sweeps=(few.sweeps[0].part(slice(_MEMORY_SAMPLES), 1),))
    tracemalloc.start()
    try:
        replay(trial.localizer(material), start)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    return {"timing": timing(least), "peak_bytes": peak}


def per_update(trade: Trade) -> float:
    """Time of a measurement update, µs."""
    return trade.update_us


def per_millimetre(trade: Trade) -> float:
    """Time per millimetre of travel, µs."""
    return trade.us_per_mm


def pareto_front(trades: Sequence[Trade], duration: Callable[[Trade], float] = per_update) -> list[Trade]:
    """Trades that no other one beats in both error and time, from fast to accurate."""
    front: list[Trade] = []
    for one in sorted(trades, key=lambda t: (duration(t), t.error.mean)):
        if not front or one.error.mean < front[-1].error.mean:
            front.append(one)
    return front


def within_budget(
    trades: Sequence[Trade], budget_us: float, duration: Callable[[Trade], float] = per_update
) -> Trade | None:
    """Most accurate trade with a time of at most ``budget_us``."""
    affordable = (t for t in trades if duration(t) <= budget_us)
    return min(affordable, key=lambda t: t.error.mean, default=None)


def for_target(trades: Sequence[Trade], target_m: float) -> Trade | None:
    """Fastest trade with a mean error of at most ``target_m``."""
    accurate = (t for t in trades if t.error.mean <= target_m)
    return min(accurate, key=lambda t: t.update_us, default=None)
