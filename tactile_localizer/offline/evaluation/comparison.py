"""Comparison of methods: tasks over conditions, and their results."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import chdtri

from tactile_localizer.core.calibration.held_out import Calibration
from tactile_localizer.core.calibration.kernel_widths import choose_kernel_widths
from tactile_localizer.core.configuration import SWEEP_MIXTURE, Configuration
from tactile_localizer.core.factory import build_localizer, convergence_criteria, learn
from tactile_localizer.core.localizer import Localizer
from tactile_localizer.core.parameters import ModelParameters
from tactile_localizer.offline.evaluation.conditions import Condition, Material
from tactile_localizer.offline.evaluation.confidence_interval import Interval, mean_interval
from tactile_localizer.offline.evaluation.jobs import (
    Progress,
    Task,
    Workers,
    configuration_identity,
    run_tasks,
)
from tactile_localizer.offline.evaluation.methods import Method
from tactile_localizer.offline.evaluation.outcome import bin_edges, blank_outcome, sweep_axis, sweep_outcome
from tactile_localizer.offline.metrics import timing, with_contact
from tactile_localizer.offline.replay import mixture_of, replay
from tactile_localizer.scene import Scene


@dataclass(frozen=True)
class Results:
    """Outcomes of every method on every condition.

    Parameters
    ----------
    conditions : in order
    methods : by name
    tasks : by method, the result of :func:`localize` for each condition
    """

    conditions: tuple[Condition, ...]
    methods: Mapping[str, Method]
    tasks: Mapping[str, Sequence[dict[str, Any]]]

    @property
    def condition_names(self) -> list[str]:
        """Names of the conditions, each once."""
        return list(dict.fromkeys(condition.name for condition in self.conditions))

    def sweeps(self, method: str, condition: str | None = None) -> list[dict[str, Any]]:
        """Outcomes of all sweeps of one condition or all, in the same order for every method."""
        return [sweep for task in self._of(method, condition) for sweep in task["sweeps"]]

    def blanks(self, method: str, condition: str | None = None) -> list[dict[str, Any]]:
        """Outcomes of all blank sweeps, which do not reach a feature."""
        return [blank for task in self._of(method, condition) for blank in task["blanks"]]

    def values(self, method: str, name: str, condition: str | None = None) -> np.ndarray:
        """One number of every sweep; NaN where unknown."""
        return as_array([sweep[name] for sweep in self.sweeps(method, condition)])

    def interval(self, method: str, name: str, condition: str | None = None) -> Interval | None:
        """Mean of one number over the sweeps, with its confidence interval."""
        return mean_interval(self.values(method, name, condition))

    def has_contact(self, condition: str) -> bool:
        """Whether contact with the feature of a condition is known."""
        return any(np.isfinite(self.values(m, "error_contact_m", condition)).any() for m in self.methods)

    def only(self, names: Sequence[str]) -> Results:
        """The results on some of the conditions."""
        kept = [index for index, condition in enumerate(self.conditions) if condition.name in names]
        tasks = {method: [of[index] for index in kept] for method, of in self.tasks.items()}
        return Results(tuple(self.conditions[index] for index in kept), self.methods, tasks)

    def by_feature(self) -> tuple[Results | None, Results | None]:
        """The results on conditions with known contact, and those on the others; ``None``: there are none."""
        known = [name for name in self.condition_names if self.has_contact(name)]
        rest = [name for name in self.condition_names if name not in known]
        return self.only(known) if known else None, self.only(rest) if rest else None

    def compared_error(self) -> tuple[str, str]:
        """Name of the error that methods are compared by, and its description."""
        if any(map(self.has_contact, self.condition_names)):
            return "error_contact_m", "from contact to the feature's end"
        return "error_m", "over the sweep"

    def sweep_axis(self, condition: str) -> tuple[str, np.ndarray]:
        """Axis of a condition's sweeps, and the centres of the bins of the curves along it."""
        task = self._of(next(iter(self.methods)), condition)[0]
        edges = np.array(task["edges_m"])
        return task["axis"], (edges[:-1] + edges[1:]) / 2

    def times(self, method: str) -> tuple[float, float]:
        """Medians over the tasks of the median update time and of its 99th percentile, us."""
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
    """Numbers as an array, NaN for ``None``."""
    return np.array([np.nan if value is None else float(value) for value in values])


def evaluate(
    conditions: Sequence[Condition],
    methods: Sequence[Method],
    folder: Path,
    workers: Workers,
    progress: Progress | None = None,
) -> Results:
    """Try every method on every condition; results that ``folder`` holds are reused.

    Raises
    ------
    ParameterError
        An unusable configuration, or unavailable workers.
    """
    learned = learn_conditions(conditions, folder, workers, progress)
    kernels = [method for method in methods if method.configuration.model != SWEEP_MIXTURE]
    widths = kernel_widths(conditions, folder, workers, progress) if kernels else [{}] * len(conditions)
    tasks = []
    for method in methods:
        for condition, calibration, own in zip(conditions, learned, widths, strict=True):
            measurement = {**own, **method.measurement} if method in kernels else {}
            tasks.append(localization_task(condition, calibration, measurement, method.configuration))
    results = run_tasks(tasks, folder, workers, progress, "localizing")
    n = len(conditions)
    by_method = {method.name: results[i * n : (i + 1) * n] for i, method in enumerate(methods)}
    return Results(tuple(conditions), {method.name: method for method in methods}, by_method)


def learn_conditions(
    conditions: Sequence[Condition], folder: Path, workers: Workers, progress: Progress | None = None
) -> list[dict[str, Any]]:
    """The calibration of every condition, as plain values."""
    tasks = [Task(learn_condition, (condition,), condition.map_identity) for condition in conditions]
    return run_tasks(tasks, folder, workers, progress, "learning from the scans")


def learn_condition(condition: Condition) -> dict[str, Any]:
    """The calibration of a condition's scan."""
    material = condition.load()
    calibration = learn(material.scan, material.scene)
    return {**calibration._asdict(), "registration_std": calibration.registration_std.tolist()}


def kernel_widths(
    conditions: Sequence[Condition], folder: Path, workers: Workers, progress: Progress | None = None
) -> list[dict[str, Any]]:
    """Parameters of the kernel models for every condition: given by its scene or chosen from the scan."""
    tasks = [Task(choose_widths, (condition,), condition.map_identity) for condition in conditions]
    return run_tasks(tasks, folder, workers, progress, "choosing kernel widths")


def choose_widths(condition: Condition) -> dict[str, Any]:
    """Parameters of the kernel models for a condition: given by its scene or chosen from the scan."""
    material = condition.load()
    given = ModelParameters.from_mapping(material.scene.measurement)
    if given.position_std is None or given.strain_std is None:
        given = choose_kernel_widths(material.scan, material.scene, given)
    return given.to_mapping()


def localization_task(
    condition: Condition,
    calibration: dict[str, Any],
    measurement: dict[str, Any],
    configuration: Configuration,
) -> Task:
    """The task of :func:`localize`."""
    identity = {
        "condition": condition.identity,
        "calibration": calibration,
        "measurement": measurement,
        "configuration": configuration_identity(configuration),
    }
    return Task(localize, (condition, calibration, measurement, configuration), identity)


def localize(
    condition: Condition,
    calibration: dict[str, Any],
    measurement: dict[str, Any],
    configuration: Configuration,
) -> dict[str, Any]:
    """Outcomes of a condition's sweeps and blank sweeps, and computing times."""
    material = condition.load()
    scene = replace(material.scene, measurement=measurement)
    localizer = built(condition, material, calibration, measurement, configuration)
    # Processor time, because tasks share the machine.
    recording = with_contact(material.recording, scene, mixture_of(localizer).map)
    tracks = replay(localizer, recording, clock=time.thread_time)
    blanks = replay(localizer, material.blank) if material.blank is not None else []
    axis = sweep_axis(scene, tracks)
    return {
        "axis": scene.axis_names[axis],
        "edges_m": bin_edges(scene, axis).tolist(),
        "sweeps": [sweep_outcome(scene, track, axis) for track in tracks],
        "blanks": [blank_outcome(track) for track in blanks],
        "narrow_trace_m2": _narrow_trace(configuration, scene),
        "timing": timing(tracks),
    }


def built(
    condition: Condition,
    material: Material,
    calibration: dict[str, Any],
    measurement: dict[str, Any],
    configuration: Configuration,
) -> Localizer:
    """The localizer of a task."""
    return build_localizer(
        material.scan,
        replace(material.scene, measurement=measurement),
        configuration,
        np.random.default_rng(condition.seed),
        calibration=Calibration(calibration["information_length"], np.array(calibration["registration_std"])),
    )


def _narrow_trace(configuration: Configuration, scene: Scene) -> float:
    """Trace of a normal belief that is just narrow enough for convergence on every axis."""
    criteria = convergence_criteria(scene, configuration)
    inside = chdtri(scene.dimension, 1.0 - criteria.probability)
    return float(np.sum(criteria.radius**2) / inside)
