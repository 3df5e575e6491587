"""Comparison of methods: tasks over conditions, and their results."""

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
from tactile_localizer.core.calibration.held_out import Calibration
from tactile_localizer.core.calibration.kernel_widths import choose_kernel_widths
from tactile_localizer.core.configuration import SWEEP_MIXTURE, Configuration
from tactile_localizer.core.factory import build_localizer, learn
from tactile_localizer.core.localizer import Localizer
from tactile_localizer.core.parameters import ModelParameters
from tactile_localizer.offline.metrics import timing, with_contact
from tactile_localizer.offline.replay import Track, mixture_of, replay
from tactile_localizer.scene import Scene


@dataclass(frozen=True)
class Method:
    """A named configuration.

    Parameters
    ----------
    name : in tables and figures
    configuration : choices of the user
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

    def compared_error(self) -> tuple[str, str]:
        """Name of the error that methods are compared by, and its description."""
        if any(map(self.has_contact, self.condition_names)):
            return "error_contact_m", "from contact to the feature's end"
        return "error_m", "over the sweep"

    def _of(self, method: str, condition: str | None) -> list[dict[str, Any]]:
        return [
            task
            for task, tried in zip(self.tasks[method], self.conditions, strict=True)
            if condition in (None, tried.name)
        ]


def as_array(values: Sequence[float | None]) -> np.ndarray:
    """Numbers as an array, NaN for ``None``."""
    return np.array([np.nan if value is None else float(value) for value in values])


@dataclass(frozen=True)
class Trial:
    """A configuration on a condition.

    Parameters
    ----------
    condition : of the evaluation
    configuration : of the localizer
    calibration : of the condition's scan, as :func:`learn_condition` returns it
    measurement : parameters of a kernel model
    """

    condition: Condition
    configuration: Configuration
    calibration: dict[str, Any]
    measurement: dict[str, Any] = field(default_factory=dict)

    def task(self, function: Callable[[Trial], dict[str, Any]]) -> Task:
        """The task of calling ``function`` with the trial."""
        identity = {
            "condition": self.condition.identity,
            "calibration": self.calibration,
            "measurement": self.measurement,
            "configuration": configuration_identity(self.configuration),
        }
        return Task(function, (self,), identity)

    def scene(self, material: Material) -> Scene:
        """The scene with the parameters of the model."""
        return replace(material.scene, measurement=self.measurement)

    def localizer(self, material: Material) -> Localizer:
        """The localizer on the loaded condition."""
        length, std = self.calibration["information_length"], self.calibration["registration_std"]
        return build_localizer(
            material.scan,
            self.scene(material),
            self.configuration,
            np.random.default_rng(self.condition.seed),
            calibration=Calibration(length, np.array(std)),
        )


def evaluate(
    conditions: Sequence[Condition],
    methods: Sequence[Method],
    folder: Path,
    workers: Workers,
    progress: Progress | None = None,
    measure: Callable[[Trial], dict[str, Any]] | None = None,
) -> Results:
    """Try every method on every condition; results that ``folder`` holds are reused.

    Parameters
    ----------
    measure : in place of :func:`localize`, with at least its results

    Raises
    ------
    ParameterError
        An unusable configuration, or unavailable workers.
    """
    tried = trials(conditions, methods, folder, workers, progress)
    tasks = [trial.task(measure or localize) for own in tried for trial in own]
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
    """For each method its trials on the conditions, with what is learned from their scans."""
    learned = learn_conditions(conditions, folder, workers, progress)
    kernels = [method for method in methods if method.configuration.model != SWEEP_MIXTURE]
    widths: list[dict[str, Any]] = [{}] * len(conditions)
    if kernels:  # given by the scenes or chosen from the scans
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
    """The calibration of every condition, as plain values."""
    tasks = [Task(learn_condition, (condition,), condition.map_identity) for condition in conditions]
    return run_tasks(tasks, folder, workers, progress, "learning from the scans")


def learn_condition(condition: Condition) -> dict[str, Any]:
    """The calibration of a condition's scan."""
    material = condition.load()
    calibration = learn(material.scan, material.scene)
    return {**calibration._asdict(), "registration_std": calibration.registration_std.tolist()}


def choose_widths(condition: Condition) -> dict[str, Any]:
    """Parameters of the kernel models for a condition: given by its scene or chosen from the scan."""
    material = condition.load()
    given = ModelParameters.from_mapping(material.scene.measurement)
    if given.position_std is None or given.strain_std is None:
        given = choose_kernel_widths(material.scan, material.scene, given)
    return given.to_mapping()


def localize(trial: Trial) -> dict[str, Any]:
    """Outcomes of a condition's sweeps and blank sweeps, and computing times."""
    scene, tracks, blanks = replayed(trial)
    return {
        "sweeps": [sweep_outcome(scene, track) for track in tracks],
        "blanks": [{"converged": bool(track.converged.any())} for track in blanks],
        "timing": timing(tracks),
    }


def replayed(trial: Trial) -> tuple[Scene, list[Track], list[Track]]:
    """Scene of a trial, and replays of its condition's sweeps and blank sweeps."""
    material = trial.condition.load()
    scene, localizer = trial.scene(material), trial.localizer(material)
    # Processor time, because tasks share the machine.
    recording = with_contact(material.recording, scene, mixture_of(localizer).map)
    tracks = replay(localizer, recording, clock=time.thread_time)
    return scene, tracks, replay(localizer, material.blank) if material.blank is not None else []
