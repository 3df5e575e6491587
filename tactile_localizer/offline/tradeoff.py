"""Accuracy against computing time of several configurations on the same sweeps.

Each candidate replays each recording, in one or several processes. Times are processor times of one thread,
so that candidates may run beside each other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from tactile_localizer.core.calibration.calibration import Calibration
from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.core.scan.range import ScanRange
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import ParameterError, TactileLocalizerError, located
from tactile_localizer.io.configuration_file import PRESETS, load_configuration
from tactile_localizer.offline.metrics import ContactMap, contact_map, covered, position_error, timing
from tactile_localizer.offline.parallel import Progress, in_parallel
from tactile_localizer.offline.recordings import Read, ReplayedRecording, joined, replay_recording
from tactile_localizer.offline.verdict import Verdict, judge
from tactile_localizer.scene import Scene

DEFAULT = "default"
"""Name of the default configuration beside those of the presets."""


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


@dataclass(frozen=True, eq=False)
class Trade:
    """Accuracy and cost of a candidate on the S sweeps of a recording.

    Parameters
    ----------
    candidate : what was measured
    errors : (S,) mean error of each sweep, m, from contact to the feature's end; over the whole sweeps if
        none reaches contact. NaN where unknown
    coverage : fraction of the same estimates whose 95 % region contains the truth, mean over the sweeps
    verdict : verdict on the sweeps
    update_us, update_p99_us : processor time of a measurement update, median and 99th percentile, µs
    us_per_mm : processor time per millimetre of travel, µs
    """

    candidate: Candidate
    errors: np.ndarray
    coverage: float
    verdict: Verdict
    update_us: float
    update_p99_us: float
    us_per_mm: float

    @property
    def error(self) -> float:
        """Mean error over the sweeps, m."""
        return float(np.nanmean(self.errors))

    def difference(self, other: Trade) -> tuple[float, float]:
        """Mean over the sweeps of this error minus that of another, and half its 95 % interval, m.

        The sweeps are the same, so differences are more certain than the errors.
        """
        from scipy.special import stdtrit

        found = self.errors - other.errors
        found = found[np.isfinite(found)]
        count = len(found)
        half = stdtrit(count - 1, 0.975) * found.std(ddof=1) / np.sqrt(count) if count > 1 else np.nan
        return float(found.mean()), float(half)


def candidates(scene: Scene) -> list[Candidate]:
    """Default, presets, and configurations that the scene can have, without those that would be the same.

    They vary filter, cell (on one axis it is fixed), particles and update distance.
    """
    default = Configuration()
    varied = {name: named_configuration(name) for name in (DEFAULT, *PRESETS)}
    cells = (default.cell,) if scene.dimension == 1 else (0.3, default.cell, 0.6, 1.0)
    for step in (0.0005, 0.001, 0.0015, 0.003):
        for cell in cells:
            varied[f"cell {cell:g}, {step * 1e3:g} mm"] = replace(default, cell=cell, update_distance=step)
    for step in (0.0005, 0.001):
        for count in (300, 1000):
            changed = replace(default, filter="particle", particles=count, update_distance=step)
            varied[f"{count} particles, {step * 1e3:g} mm"] = changed
    names: dict[Configuration, str] = {}
    for name, configuration in varied.items():
        cell = default.cell if scene.dimension == 1 else configuration.cell
        names.setdefault(replace(configuration, cell=cell), name)
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
    load: Callable[[], Scan],
    scene: Scene,
    reads: Sequence[Read],
    measured: Sequence[Candidate],
    calibration: Calibration,
    *,
    seed: int = 0,
    jobs: int = 1,
    cluster: str | None = None,
    progress: Progress | None = None,
) -> tuple[list[Trade], dict[str, str]]:
    """Replay recordings with every candidate.

    Parameters
    ----------
    load : gives the training pairs, in any process
    scene : scene of the map
    reads : give recordings with known truth, in any process
    measured : configurations to compare
    calibration : calibration of the scan
    seed : seed of the particle filters
    jobs : processes on this machine; -1: one per core
    cluster : address of a Dask scheduler whose workers are used instead
    progress : called with a description of the work and the completed fraction

    Returns
    -------
    list of Trade
        Of the candidates that could be measured, in their order.
    dict
        Why the others could not, by name: a :class:`.Lost` where it was the machine.

    Raises
    ------
    ParameterError
        A recording without truth, an invalid number of jobs, or no scheduler.
    """
    scan, rng = load(), np.random.default_rng(seed)
    exact = build_localizer(scan, scene, Configuration(), rng, calibration=calibration)
    contact, bounds = contact_map(exact.model), ScanRange.of(scan, scene)
    del scan, exact
    calls = [
        (load, scene, read, contact, bounds, calibration, seed, candidate)
        for read in reads
        for candidate in measured
    ]
    found = dict(in_parallel(_replayed, calls, jobs=jobs, cluster=cluster, progress=progress))
    trades: list[Trade] = []
    failed: dict[str, str] = {}
    for number, candidate in enumerate(measured):
        parts = [found[call] for call in range(number, len(calls), len(measured))]
        reasons = [part for part in parts if isinstance(part, str)]
        outcome = next(iter(reasons), "") or _traded(candidate, joined(parts))
        if isinstance(outcome, Trade):
            trades.append(outcome)
        else:
            failed[candidate.name] = outcome
    return trades, failed


def _replayed(
    load: Callable[[], Scan],
    scene: Scene,
    read: Read,
    contact: ContactMap | None,
    bounds: ScanRange,
    calibration: Calibration,
    seed: int,
    candidate: Candidate,
    progress: Progress | None,
) -> ReplayedRecording | str:
    """A recording replayed with a candidate, or why that is impossible."""
    read = cache(read)
    recording, _ = read()
    if any(sweep.truth is None for sweep in recording.sweeps):
        raise ParameterError(f"{recording.source}: expected true positions, found none")
    configuration, rng = candidate.configuration, np.random.default_rng(seed)
    try:
        localizer = build_localizer(load(), scene, configuration, rng, calibration=calibration)
        return replay_recording(read, lambda: localizer, contact, bounds, progress)
    except Exception as error:  # of any kind, also of a user's model: the other candidates keep their rows
        return str(error) if isinstance(error, TactileLocalizerError) else located(error)


def _traded(candidate: Candidate, replayed: ReplayedRecording) -> Trade | str:
    """Accuracy and cost of a candidate, or why they are unknown."""
    sweeps = replayed.sweeps
    times = timing(sweeps)
    if times["us_per_mm"] is None:
        return f"{replayed.source}: expected sweeps with measurement updates, found none"
    has_contact = any(sweep.reaches_contact for sweep in sweeps)
    kept = [np.flatnonzero(sweep.on_contact | (not has_contact)) for sweep in sweeps]
    errors, inside = (
        [
            values(sweep)[rows].mean() if len(rows) else np.nan
            for sweep, rows in zip(sweeps, kept, strict=True)
        ]
        for values in (position_error, covered)
    )
    return Trade(
        candidate,
        np.array(errors),
        float(np.nanmean(inside)),
        judge(sweeps),
        *(times[name] for name in ("update_median_us", "update_p99_us", "us_per_mm")),
    )


def pareto_front(trades: Sequence[Trade]) -> list[Trade]:
    """Trades that no other one equals or beats in error, time per millimetre and number of wrong sweeps."""
    costs = np.array([(one.error, one.us_per_mm, one.verdict.wrong) for one in trades])
    worse = [((costs <= own).all(axis=1) & (costs < own).any(axis=1)).any() for own in costs]
    return [one for one, is_worse in zip(trades, worse, strict=True) if not is_worse]


def for_target(trades: Sequence[Trade], target_m: float) -> Trade | None:
    """The fastest, among those with fewest wrong sweeps, of the trades within ``target_m`` of mean error."""
    accurate = (one for one in trades if one.error <= target_m)
    return min(accurate, key=lambda one: (one.verdict.wrong, one.us_per_mm, one.error), default=None)
