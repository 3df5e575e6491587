"""Accuracy against cost: many configurations tried, those that nothing beats, and answers from them."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tactile_localizer.core.assembly import build_localizer
from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.parameters import ModelParameters
from tactile_localizer.evaluation.bootstrap import Interval, mean_interval
from tactile_localizer.evaluation.conditions import Condition, Material
from tactile_localizer.evaluation.evaluate import as_array, choose, localise
from tactile_localizer.evaluation.jobs import Progress, Task, Workers, run_tasks
from tactile_localizer.evaluation.odometry import piece
from tactile_localizer.evaluation.replay import replay
from tactile_localizer.io.configuration_file import PRESETS, load_configuration

_WIDEST = 200
"""Samples from the start of a sweep, in which memory is measured."""

NEIGHBOURS = ModelParameters().neighbours
"""Of the Gaussian models, where nothing else is said."""


@dataclass(frozen=True)
class Candidate:
    """A configuration to try.

    Parameters
    ----------
    configuration : choices of the user
    neighbours : of the Gaussian models
    every : the map keeps each so-many-th pair of the scan
    preset : its name, if it is one
    """

    configuration: Configuration
    neighbours: int = NEIGHBOURS
    every: int = 1
    preset: str = ""

    @property
    def changes(self) -> dict[str, Any]:
        """What the configuration sets otherwise than the defaults do."""
        default = asdict(Configuration())
        return {k: v for k, v in asdict(self.configuration).items() if v != default[k]}

    @property
    def name(self) -> str:
        """All that makes this candidate, in a few words."""
        own, default = self.configuration, Configuration()
        parts = [f"{self.preset}:"] if self.preset else []
        parts += [own.model, f"grid {own.cell:g}" if own.filter == "grid" else f"particle {own.particles}"]
        parts += ["adaptive"] if own.adaptive else []
        parts += [str(getattr(own, n)) for n in ("evaluation", "precision") if n in self.changes]
        step = own.update_distance
        parts += [f"{step * 1e3:g} mm"] if step != default.update_distance else []
        parts += [f"k {self.neighbours}"] if self.neighbours != NEIGHBOURS else []
        parts += [f"map 1/{self.every}"] if self.every != 1 else []
        return " ".join(parts)


@dataclass(frozen=True)
class Trade:
    """What a candidate gives and costs.

    Parameters
    ----------
    error : m, mean from contact to the feature's end (over the sweep where contact is not known)
    coverage : share of estimates whose 95 % region holds the truth
    update_us, update_p99_us : processor time of a weighed strain, median and 99th percentile
    us_per_mm : processor time a millimetre of travel
    memory_mb : most memory held, beside the scan, MB
    """

    candidate: Candidate
    error: Interval
    coverage: float
    update_us: float
    update_p99_us: float
    us_per_mm: float
    memory_mb: float


@dataclass(frozen=True)
class Thinned:
    """A condition whose map keeps only each so-many-th pair."""

    condition: Condition
    every: int

    @property
    def identity(self) -> dict[str, Any]:
        """What tells this condition from others."""
        return {**self.condition.identity, "every": self.every}

    @property
    def name(self) -> str:
        """Name of the condition."""
        return self.condition.name

    @property
    def seed(self) -> int:
        """Seed of the condition."""
        return self.condition.seed

    def load(self) -> Material:
        """The condition with a thinner map."""
        material = self.condition.load()
        kept = np.arange(0, len(material.scan), self.every)
        return replace(material, scan=material.scan.select(kept), blank=None)


def candidates() -> list[Candidate]:
    """Configurations over model, filter, evaluation, particles, cells, neighbours, map size and precision."""
    found = [Candidate(load_configuration(preset), preset=preset) for preset in PRESETS]
    found += [Candidate(configuration) for configuration in _configurations()]
    base = Configuration()
    small = replace(base, filter="particle", particles=300)
    found += [Candidate(one, every=every) for one in (base, small) for every in (2, 4, 8)]
    for model in ("gaussian", "gaussian_independent"):
        one = replace(base, model=model, filter="particle", particles=300)
        found += [Candidate(one, neighbours=k) for k in (4, 16)]
    unique: dict[tuple[Any, ...], Candidate] = {}
    for candidate in found:
        unique.setdefault((candidate.configuration, candidate.neighbours, candidate.every), candidate)
    return list(unique.values())


def _configurations() -> Iterator[Configuration]:
    base = Configuration()
    for model in ("sum_of_gaussians", "featureless"):
        own = replace(base, model=model)
        for step in (0.0005, 0.001):
            for cell in (0.2, 0.3, 0.5, 0.8):
                yield replace(own, filter="grid", cell=cell, update_distance=step)
            for particles in (75, 150, 300, 1000, 3000):
                yield replace(own, filter="particle", particles=particles, update_distance=step)
        for particles in (75, 300):
            for evaluation in ("truncated", "exact"):
                yield replace(own, filter="particle", particles=particles, evaluation=evaluation)
            yield replace(own, filter="particle", particles=particles, precision="float32")
        yield replace(own, filter="grid", precision="float32")
    for model in ("gaussian", "gaussian_independent"):
        for particles in (75, 300, 1000):
            yield replace(base, model=model, filter="particle", particles=particles)
    yield replace(base, filter="particle", particles=3000, adaptive=True)


def trade(
    conditions: Sequence[Condition],
    tried: Sequence[Candidate],
    folder: Path,
    workers: Workers,
    progress: Progress | None = None,
) -> list[Trade]:
    """Try every candidate on every condition; what ``folder`` holds already is not tried again.

    Raises
    ------
    ParameterError
        Workers that cannot be had.
    """
    choosing = [Task(choose, (condition,), condition.identity) for condition in conditions]
    chosen = run_tasks(choosing, folder, workers, progress, "choosing parameters")
    tasks, weighing = [], []
    for one in tried:
        for condition, parameters in zip(conditions, chosen, strict=True):
            thinned = Thinned(condition, one.every)
            measurement = {**parameters, "neighbours": one.neighbours}
            identity = {
                "condition": thinned.identity,
                "measurement": measurement,
                "configuration": vars(one.configuration),
            }
            task = Task(localise, (thinned, measurement, one.configuration), identity)
            tasks.append(task)
            if condition is conditions[0]:
                weighing.append(Task(memory, task.arguments, identity))
    results = run_tasks(tasks, folder, workers, progress, "trying configurations")
    sizes = run_tasks(weighing, folder, workers, progress, "measuring memory")
    n = len(conditions)
    return [_gather(one, results[i * n : (i + 1) * n], sizes[i]["peak_bytes"]) for i, one in enumerate(tried)]


def memory(
    condition: Condition | Thinned, measurement: dict[str, Any], configuration: Configuration
) -> dict[str, Any]:
    """Most memory that a localizer holds beside the scan, bytes: at first, when the belief is widest."""
    material = condition.load()
    scene = replace(material.scene, measurement=measurement)
    start = piece(material.recording.sweeps[0], slice(_WIDEST), 1)
    recording = replace(material.recording, sweeps=(start,))
    tracemalloc.start()
    try:
        localizer = build_localizer(
            material.scan, scene, configuration, np.random.default_rng(condition.seed)
        )
        replay(localizer, recording)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    return {"peak_bytes": peak}


def _gather(candidate: Candidate, results: Sequence[dict[str, Any]], peak_bytes: int) -> Trade:
    sweeps = [sweep for result in results for sweep in result["sweeps"]]
    contact = as_array([sweep["error_contact_m"] for sweep in sweeps])
    errors = contact if np.isfinite(contact).any() else as_array([sweep["error_m"] for sweep in sweeps])
    times = [result["timing"] for result in results]
    error = mean_interval(errors) or Interval(np.nan, np.nan, np.nan)
    return Trade(
        candidate,
        error,
        coverage=float(np.nanmean(as_array([sweep["coverage"] for sweep in sweeps]))),
        update_us=float(np.median([time["update_median_us"] for time in times])),
        update_p99_us=float(np.median([time["update_p99_us"] for time in times])),
        us_per_mm=float(np.mean([time["us_per_mm"] for time in times])),
        memory_mb=peak_bytes / 1e6,
    )


def pareto_front(trades: Sequence[Trade]) -> list[Trade]:
    """The trades that no other beats in both error and update time, from cheap to accurate."""
    front: list[Trade] = []
    for one in sorted(trades, key=lambda t: (t.update_us, t.error.mean)):
        if not front or one.error.mean < front[-1].error.mean:
            front.append(one)
    return front


def within_budget(trades: Sequence[Trade], budget_us: float) -> Trade | None:
    """The most accurate of the trades on the whole map whose median update takes at most ``budget_us``."""
    affordable = (t for t in trades if t.update_us <= budget_us and t.candidate.every == 1)
    return min(affordable, key=lambda t: t.error.mean, default=None)


def for_target(trades: Sequence[Trade], target_m: float) -> Trade | None:
    """The cheapest of the trades on the whole map whose mean error is at most ``target_m``."""
    accurate = (t for t in trades if t.error.mean <= target_m and t.candidate.every == 1)
    return min(accurate, key=lambda t: t.update_us, default=None)
