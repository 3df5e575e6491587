"""Comparison of methods: every method on every condition, and the results."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from evaluation.conditions import Condition, Material
from evaluation.confidence_interval import Interval, mean_interval
from evaluation.jobs import (
    Progress,
    Task,
    Workers,
    configuration_identity,
    run_tasks,
)
from evaluation.outcome import sweep_outcome
from tactile_localizer.core.calibration.kernel_widths import choose_kernel_widths
from tactile_localizer.core.configuration import SWEEP_MIXTURE, Configuration
from tactile_localizer.core.factory import build_localizer, learn
from tactile_localizer.core.localizer import Localizer
from tactile_localizer.core.parameters import ModelParameters
from tactile_localizer.io.scans.learned import calibration_from_dict, calibration_to_dict
from tactile_localizer.offline.metrics import timing, with_contact
from tactile_localizer.offline.replay import Track, replay
from tactile_localizer.scene import Scene


@dataclass(frozen=True)
class Method:
    """A named configuration.

    Parameters
    ----------
    name : name in tables and figures
    configuration : configuration of the localizer
    measurement : parameters of a kernel model that override those of the scene
    """

    name: str
    configuration: Configuration
    measurement: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Results:
    """Outcomes of every method on every condition.

    Parameters
    ----------
    conditions : the conditions
    methods : methods by name
    tasks : by method, the result of :func:`localize` for each condition
    """

    conditions: tuple[Condition, ...]
    methods: Mapping[str, Method]
    tasks: Mapping[str, Sequence[dict[str, Any]]]

    @property
    def condition_names(self) -> list[str]:
        """Distinct names of the conditions."""
        return list(dict.fromkeys(condition.name for condition in self.conditions))

    def sweeps(self, method: str, condition: str | None = None) -> list[dict[str, Any]]:
        """Outcomes of all sweeps of one condition or of all, in the same order for every method."""
        return [sweep for task in self._of(method, condition) for sweep in task["sweeps"]]

    def blanks(self, method: str, condition: str | None = None) -> list[dict[str, Any]]:
        """Outcomes of all blank sweeps, which do not reach a feature."""
        return [blank for task in self._of(method, condition) for blank in task["blanks"]]

    def values(self, method: str, name: str, condition: str | None = None) -> np.ndarray:
        """One value of every sweep; NaN where unknown."""
        return as_array([sweep[name] for sweep in self.sweeps(method, condition)])

    def interval(self, method: str, name: str, condition: str | None = None) -> Interval | None:
        """Mean of one value over the sweeps, with its confidence interval."""
        return mean_interval(self.values(method, name, condition))

    def has_contact(self, condition: str) -> bool:
        """Whether contact with the feature is known in a condition."""
        return any(np.isfinite(self.values(m, "error_contact_m", condition)).any() for m in self.methods)

    def compared_error(self) -> tuple[str, str]:
        """Name and description of the error by which methods are compared."""
        if any(map(self.has_contact, self.condition_names)):
            return "error_contact_m", "from contact to the feature's end"
        return "error_m", "over the sweep"

    def _of(self, method: str, condition: str | None) -> list[dict[str, Any]]:
        return [
            task
            for task, own in zip(self.tasks[method], self.conditions, strict=True)
            if condition in (None, own.name)
        ]


def as_array(values: Sequence[float | None]) -> np.ndarray:
    """Convert numbers to an array with NaN for ``None``."""
    return np.array([np.nan if value is None else float(value) for value in values])


@dataclass(frozen=True)
class Trial:
    """A configuration on a condition.

    Parameters
    ----------
    condition : condition of the evaluation
    configuration : configuration of the localizer
    calibration : calibration of the condition's scan, from :func:`learn_condition`
    measurement : parameters of a kernel model
    """

    condition: Condition
    configuration: Configuration
    calibration: dict[str, Any]
    measurement: dict[str, Any] = field(default_factory=dict)

    def task(self, function: Callable[[Trial], dict[str, Any]]) -> Task:
        """Task that calls ``function`` with the trial."""
        identity = {
            "condition": self.condition.identity,
            "calibration": self.calibration,
            "measurement": self.measurement,
            "configuration": configuration_identity(self.configuration),
        }
        return Task(function, (self,), identity)

    def scene(self, material: Material) -> Scene:
        """Scene with the parameters of the measurement model."""
        return replace(material.scene, measurement=self.measurement)

    def localizer(self, material: Material) -> Localizer:
        """Localizer on the loaded condition."""
        return build_localizer(
            material.scan,
            self.scene(material),
            self.configuration,
            np.random.default_rng(self.condition.seed),
            calibration=calibration_from_dict(self.calibration),
        )


def evaluate(
    conditions: Sequence[Condition],
    methods: Sequence[Method],
    folder: Path,
    workers: Workers,
    progress: Progress | None = None,
    measure: Callable[[Trial], dict[str, Any]] | None = None,
) -> Results:
    """Evaluate every method on every condition.

    Parameters
    ----------
    conditions, methods : what is compared
    folder : folder of stored results, which are reused
    workers : workers of the tasks
    progress : called with a description of the work and the completed fraction
    measure : replaces :func:`localize`; returns at least its results

    Raises
    ------
    ParameterError
        An invalid configuration, or unavailable workers.
    """
    planned = trials(conditions, methods, folder, workers, progress)
    tasks = [trial.task(measure or localize) for own in planned for trial in own]
    results = run_tasks(tasks, folder, workers, progress, "localizing")
    n = len(conditions)
    by_method = {method.name: results[i * n : (i + 1) * n] for i, method in enumerate(methods)}
    return Results(tuple(conditions), {method.name: method for method in methods}, by_method)


def trials(
    conditions: Sequence[Condition],
    methods: Sequence[Method],
    folder: Path,
    workers: Workers,
    progress: Progress | None = None,
) -> list[list[Trial]]:
    """Trials of each method on the conditions, with the calibrations of their scans."""
    learned = learn_conditions(conditions, folder, workers, progress)
    kernels = [method for method in methods if method.configuration.model != SWEEP_MIXTURE]
    widths: list[dict[str, Any]] = [{}] * len(conditions)
    if kernels:
        tasks = [Task(choose_widths, (condition,), condition.map_identity) for condition in conditions]
        widths = run_tasks(tasks, folder, workers, progress, "choosing kernel widths")
    return [
        [
            Trial(condition, method.configuration, calibration, {**own, **method.measurement})
            if method in kernels
            else Trial(condition, method.configuration, calibration)
            for condition, calibration, own in zip(conditions, learned, widths, strict=True)
        ]
        for method in methods
    ]


def learn_conditions(
    conditions: Sequence[Condition], folder: Path, workers: Workers, progress: Progress | None = None
) -> list[dict[str, Any]]:
    """Calibrations of all conditions, as values that JSON can hold."""
    tasks = [Task(learn_condition, (condition,), condition.map_identity) for condition in conditions]
    return run_tasks(tasks, folder, workers, progress, "learning from the scans")


def learn_condition(condition: Condition) -> dict[str, Any]:
    """Calibration of a condition's scan."""
    material = condition.load()
    return calibration_to_dict(learn(material.scan, material.scene))


def choose_widths(condition: Condition) -> dict[str, Any]:
    """Parameters of the kernel models for a condition, from its scene or else chosen from the scan."""
    material = condition.load()
    given = ModelParameters.from_mapping(material.scene.measurement)
    if given.position_std is None or given.strain_std is None:
        given = choose_kernel_widths(material.scan, material.scene, given)
    return given.to_mapping()


def localize(trial: Trial) -> dict[str, Any]:
    """Outcomes of the sweeps and blank sweeps of a condition, and computing times."""
    scene, tracks, blanks = replayed(trial)
    return {
        "sweeps": [sweep_outcome(scene, track) for track in tracks],
        "blanks": [{"converged": bool(track.converged.any())} for track in blanks],
        "timing": timing(tracks),
    }


def replayed(trial: Trial) -> tuple[Scene, list[Track], list[Track]]:
    """Scene of a trial, and replays of the sweeps and blank sweeps of its condition."""
    material = trial.condition.load()
    scene, localizer = trial.scene(material), trial.localizer(material)
    # Processor time, because other tasks run at the same time.
    recording = with_contact(material.recording, scene, localizer.model.map)
    tracks = replay(localizer, recording, clock=time.thread_time)
    return scene, tracks, replay(localizer, material.blank) if material.blank is not None else []
