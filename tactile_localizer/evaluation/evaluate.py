"""Many sweeps by many methods: the tasks, and their results gathered."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer, completed
from tactile_localizer.core.likelihood.neighbours import choose_neighbours
from tactile_localizer.core.parameters import ModelParameters
from tactile_localizer.core.selection import choose_parameters
from tactile_localizer.evaluation.bootstrap import Interval, mean_interval
from tactile_localizer.evaluation.conditions import Condition
from tactile_localizer.evaluation.jobs import Progress, Task, Workers, run_tasks, told
from tactile_localizer.evaluation.methods import SCENE, TUNED, Method
from tactile_localizer.evaluation.metrics import timing
from tactile_localizer.evaluation.outcome import bin_edges, blank_outcome, sweep_axis, sweep_outcome
from tactile_localizer.evaluation.replay import replay
from tactile_localizer.scene import Scene


@dataclass(frozen=True)
class Results:
    """Outcomes of every method on every condition.

    Parameters
    ----------
    conditions : what was tried, in order
    methods : by name
    tasks : by method, the result of :func:`localise` for each condition
    """

    conditions: tuple[Condition, ...]
    methods: Mapping[str, Method]
    tasks: Mapping[str, Sequence[dict[str, Any]]]

    @property
    def condition_names(self) -> list[str]:
        """Names of the conditions, each once."""
        return list(dict.fromkeys(condition.name for condition in self.conditions))

    def sweeps(self, method: str, condition: str | None = None) -> list[dict[str, Any]]:
        """Outcomes of all sweeps, over all seeds, of one condition or all; in one order for all methods."""
        return [sweep for task in self._of(method, condition) for sweep in task["sweeps"]]

    def blanks(self, method: str, condition: str | None = None) -> list[dict[str, Any]]:
        """Outcomes of all sweeps that never reach a feature."""
        return [blank for task in self._of(method, condition) for blank in task["blanks"]]

    def values(self, method: str, name: str, condition: str | None = None) -> np.ndarray:
        """One number of every sweep; NaN where it is not known."""
        return as_array([sweep[name] for sweep in self.sweeps(method, condition)])

    def interval(self, method: str, name: str, condition: str | None = None) -> Interval | None:
        """Mean of one number over the sweeps, with its confidence interval."""
        return mean_interval(self.values(method, name, condition))

    def felt(self, condition: str) -> bool:
        """Whether it is known when the feature of a condition is touched."""
        return any(np.isfinite(self.values(m, "error_contact_m", condition)).any() for m in self.methods)

    def only(self, names: Sequence[str]) -> Results:
        """The results on some of the conditions."""
        kept = [index for index, condition in enumerate(self.conditions) if condition.name in names]
        tasks = {method: [of[index] for index in kept] for method, of in self.tasks.items()}
        return Results(tuple(self.conditions[index] for index in kept), self.methods, tasks)

    def sweep_axis(self, condition: str) -> tuple[str, np.ndarray]:
        """Name of the axis that a condition's sweeps go along, and middles of the curves' stretches on it."""
        task = self._of(next(iter(self.methods)), condition)[0]
        edges = np.array(task["edges_m"])
        return task["axis"], (edges[:-1] + edges[1:]) / 2

    def times(self, method: str) -> tuple[float, float]:
        """Median update time, and the largest 99th percentile of the tasks, us."""
        of = [task["timing"] for task in self.tasks[method]]
        medians = [t["update_median_us"] for t in of if t["update_median_us"] is not None]
        if not medians:
            return np.nan, np.nan
        return float(np.median(medians)), float(np.median([t["update_p99_us"] for t in of]))

    def _of(self, method: str, condition: str | None) -> list[dict[str, Any]]:
        return [
            task
            for task, tried in zip(self.tasks[method], self.conditions, strict=True)
            if condition in (None, tried.name)
        ]


def as_array(values: Sequence[float | None]) -> np.ndarray:
    """Numbers with NaN for what is not known."""
    return np.array([np.nan if value is None else float(value) for value in values])


def evaluate(
    conditions: Sequence[Condition],
    methods: Sequence[Method],
    folder: Path,
    workers: Workers,
    progress: Progress | None = None,
) -> Results:
    """Try every method on every condition; what ``folder`` holds already is not tried again.

    Raises
    ------
    ParameterError
        A configuration that cannot be used, or workers that cannot be had.
    """
    tasks = []
    parameters = chosen_parameters(conditions, methods, folder, workers, progress)
    for method in methods:
        for condition, own in zip(conditions, parameters[method.parameters], strict=True):
            measurement = {**own, **method.measurement}
            identity = {
                "condition": condition.identity,
                "measurement": measurement,
                "configuration": told(method.configuration),
            }
            tasks.append(Task(localise, (condition, measurement, method.configuration), identity))
    results = run_tasks(tasks, folder, workers, progress, "localising")
    n = len(conditions)
    by_method = {method.name: results[i * n : (i + 1) * n] for i, method in enumerate(methods)}
    return Results(tuple(conditions), {method.name: method for method in methods}, by_method)


def chosen_parameters(
    conditions: Sequence[Condition],
    methods: Sequence[Method],
    folder: Path,
    workers: Workers,
    progress: Progress | None = None,
) -> dict[str, list[dict[str, Any]]]:
    """Parameters of the measurement model for every condition, by the ways that the methods get them."""
    ways = sorted({method.parameters for method in methods})
    tasks = [Task(CHOICES[way], (condition,), condition.identity) for way in ways for condition in conditions]
    chosen = run_tasks(tasks, folder, workers, progress, "choosing parameters")
    n = len(conditions)
    return {way: chosen[i * n : (i + 1) * n] for i, way in enumerate(ways)}


def choose(condition: Condition) -> dict[str, Any]:
    """Parameters of a condition's scene; what it leaves open is chosen from the scan."""
    material = condition.load()
    scene = completed(material.scan, material.scene)
    return ModelParameters.from_mapping(scene.measurement).to_mapping()


def choose_anew(condition: Condition) -> dict[str, Any]:
    """Parameters chosen from a condition's scan, as ``tune`` does; those of the scene do not count."""
    material = condition.load()
    widths = choose_parameters(material.scan, material.scene)
    neighbours = choose_neighbours(material.scan, material.scene)
    return replace(widths, neighbours=neighbours).to_mapping()


CHOICES = {SCENE: choose, TUNED: choose_anew}


def localise(
    condition: Condition, measurement: dict[str, Any], configuration: Configuration
) -> dict[str, Any]:
    """Outcomes of a condition's sweeps, of its blank sweeps, and the time that updates took."""
    material = condition.load()
    scene = replace(material.scene, measurement=measurement)
    localizer = build_localizer(material.scan, scene, configuration, np.random.default_rng(condition.seed))
    # Processor time: tasks share the machine, with each other and with others.
    tracks = replay(localizer, material.recording, clock=time.thread_time)
    blanks = replay(localizer, material.blank) if material.blank is not None else []
    axis = sweep_axis(scene, tracks)
    return {
        "axis": scene.axis_names[axis],
        "edges_m": bin_edges(scene, axis).tolist(),
        "sweeps": [
            sweep_outcome(scene, track, (int(span[0]), int(span[1])), axis)
            for track, span in zip(tracks, material.contact, strict=True)
        ],
        "blanks": [blank_outcome(track) for track in blanks],
        "narrow_trace_m2": _narrow_trace(configuration, scene),
        "timing": timing(tracks),
    }


def _narrow_trace(configuration: Configuration, scene: Scene) -> float:
    """Trace of a belief that is just narrow enough for convergence, with all axes at their limit."""
    yaw, length = configuration.convergence_yaw_std, configuration.convergence_std
    return sum((yaw if axis.name == "yaw" else length) ** 2 for axis in scene.axes)
