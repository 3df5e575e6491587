"""Localization on recorded features: a folder is a scan, and sweeps whose true positions are known.

    scripts/in_env python benchmarks/recorded.py DIR ... [--configuration NAME] [--json FILE]

A folder holds ``scene.yaml``, ``train.csv`` and ``test.csv``, and where there are, ``blank.csv`` and
``foreign_*.csv``; each may end in ``.csv.gz``. Columns are ``stamp_s``, ``sweep``, the axes (m, rad), the
channels ``<phalanx>_<number>`` (V) and ``felt``, 1 while in contact; without it, a sweep counts as in contact
all the way. A localizer is built from ``train`` and tried on the other files, reset at the start of each
sweep. Their positions are true, unless there are columns ``true_<axis>``: it gets their displacements with
noise of the scene's ``motion_std``.

A row is a folder, and under ``--passes``, ``--lines``, ``--odometry-noise``, ``--gauge-noise``,
``--noisy-channel`` or ``--texture`` a variant of it, and has

``error_mm``, ``error_settled_mm``
    mean over the sweeps of the mean error from contact to the feature's end, and from 4 mm after contact, mm
``coverage``, ``coverage_contact``
    share of the strains whose 95 % region holds the truth, over whole sweeps and from contact to the
    feature's end; mean over the sweeps
``within_5_mm``, ``within_10_mm``
    share of the sweeps that converge at most so far past contact; at ``false_before`` of them it was before
``converged``
    share of the strains from contact to the feature's end that are converged, mean over the sweeps
``false_sweeps``, ``false_strains``
    share of the sweeps that are ever, from contact on, converged and more than the convergence radius
    (7.5 mm) off; share of the converged strains, of whole sweeps, that are so far off
``again``
    share of the sweeps that are converged and right at their end, where after three quarters of a sweep the
    hand is placed elsewhere, without a displacement, and goes on with the last three quarters of another
``set_down``
    the same with the displacement, as of a hand that is lifted and set down there
``false_before``, ``false_blank``
    how many sweeps converge before contact, and how many blank sweeps ever converge
``foreign_strains``, ``foreign_sweeps``
    of the ``foreign_*`` files together: share of the strains after contact that are converged, and of the
    sweeps with such a strain
``update_us``, ``update_open_us``
    median of a measurement update that is converged, and of one that is not, processor time, us
``update_reads``, ``update_open_reads``
    the same in reads of the training strains as float32
``learning_s``
    processor time of learning from the scan, s
``learned``
    what was learned from held-out sweeps, by name
``standard_errors``, ``by_sweep``
    of the means over the sweeps, by name, from the spread of the single sweeps; and the single values

``--passes 1 2`` uses the first and the second half of the training sweeps, a row each; ``both`` is the
default. ``--lines K`` uses every K-th line. ``--odometry-noise K`` multiplies the noise of the displacements
and leaves the localizer unaware of it. ``--gauge-noise FACTOR`` raises the white noise of all channels of
``test`` and ``blank`` to that many times its standard deviation in ``train``, ``--noisy-channel WIDTHS`` adds
white noise of so many of them to their first channel. ``--texture WIDTHS`` adds a random texture of so many
standard deviations of a visit's noise to ``train``, ``test`` and ``blank``, so that no place is blank.
``--seeds`` repeats everything with other noise. The file of ``--json`` has ``arguments``, ``rows`` and
``totals``: counts summed over all rows, other measures averaged.
"""

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from measures import (
    COLUMNS,
    Row,
    by_sweep,
    ever_converged,
    falsely_converged,
    on_feature,
    on_unscanned,
    read_us,
    right_at_their_end,
    standard_errors,
    summary,
    update_times,
)
from rows import accuracy_parser, measured, print_rows

from tactile_localizer.core.calibration.calibration import Calibration
from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer, learn
from tactile_localizer.core.geometry.motion import MotionModel
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.core.likelihood.noise_model import Visits, whiten
from tactile_localizer.core.localizer import Localizer
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import ScanError
from tactile_localizer.io.csv.recording import read_csv
from tactile_localizer.io.recording import RecordedSweep, Recording, scan_of
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.offline.odometry import SIMULATED, with_odometry
from tactile_localizer.offline.replay import ReplayedSweep, replay
from tactile_localizer.offline.tradeoff import named_configuration
from tactile_localizer.scene import Scene

PASSES = ("both", "1", "2")

NORMAL_MEDIAN = 0.6745
"""Median of the absolute value of a standard normal variable."""


class Variant(NamedTuple):
    """What is changed about a folder.

    Parameters
    ----------
    passes : one of :data:`PASSES`
    lines : every so many-th line is used
    odometry_noise : factor of the noise of the displacements
    gauge_noise : factor, at least 1, of the white noise of all channels
    noisy_channel : further white noise of the first channel, in standard deviations of its own
    texture : of the material, in standard deviations of the noise of a visit
    """

    passes: str = "both"
    lines: int = 1
    odometry_noise: float = 1.0
    gauge_noise: float = 1.0
    noisy_channel: float = 0.0
    texture: float = 0.0


def load_recording(path: Path, scene: Scene) -> Recording:
    """Sweeps of a file; without a column ``felt``, all samples count as in contact."""
    recording = read_csv(path, scene)
    felt = [
        np.ones(len(sweep), dtype=bool) if sweep.felt is None else sweep.felt for sweep in recording.sweeps
    ]
    sweeps = [replace(sweep, felt=each) for sweep, each in zip(recording.sweeps, felt, strict=True)]
    return replace(recording, sweeps=tuple(sweeps))


def with_passes(recording: Recording, passes: str, lines: int) -> Recording:
    """A recording with one half of its sweeps, or all of them, and of these every ``lines``-th line."""
    half = (len(recording.sweeps) + 1) // 2
    parts = {"both": slice(None), "1": slice(half), "2": slice(half, None)}
    sweeps = recording.sweeps[parts[passes]]
    line = line_numbers(np.array([sweep.position.mean(axis=0) for sweep in sweeps]))
    kept = tuple(sweep for sweep, number in zip(sweeps, line, strict=True) if number % lines == 0)
    return replace(recording, sweeps=kept)


def white_noise_std(recording: Recording) -> np.ndarray:
    """Standard deviation (C,) of each channel's white noise, V: the median over the sweeps.

    Second differences of successive strains show it, without a map: what the hand feels changes slowly.
    """
    sweeps = [np.diff(sweep.strain, n=2, axis=0) for sweep in recording.sweeps]
    deviations = [np.nanmedian(np.abs(second), axis=0) for second in sweeps]
    return np.nanmedian(deviations, axis=0) / (NORMAL_MEDIAN * np.sqrt(6.0))


def with_added(recording: Recording, added: Callable[[RecordedSweep], np.ndarray]) -> Recording:
    """A recording with strains ``added`` (n, C), V, to those of each sweep."""
    sweeps = [replace(sweep, strain=sweep.strain + added(sweep)) for sweep in recording.sweeps]
    return replace(recording, sweeps=tuple(sweeps))


def with_white_noise(recording: Recording, std: np.ndarray, rng: np.random.Generator) -> Recording:
    """A recording with white noise of standard deviation ``std`` (C,), V, added to its strains."""
    return with_added(recording, lambda sweep: std * rng.standard_normal(sweep.strain.shape))


def with_texture(recording: Recording, std: np.ndarray) -> Recording:
    """A recording of textured material: random waves of standard deviation ``std`` (C,), V.

    Their autocorrelation is Gaussian, with a standard deviation of 3 mm.
    """
    rng, count = np.random.default_rng(3), 400
    vectors = rng.standard_normal((count, recording.sweeps[0].position.shape[1])) / 0.003
    phases = rng.uniform(0.0, 2.0 * np.pi, count)
    heights = std * rng.standard_normal((count, len(std))) * np.sqrt(2.0 / count)
    return with_added(recording, lambda sweep: np.cos(sweep.position @ vectors.T + phases) @ heights)


def placed_elsewhere(recording: Recording, motion: MotionModel, least: float, lifted: bool) -> Recording:
    """Sweeps in which the hand is once placed elsewhere on the material.

    Either it is ``lifted``, or the material is moved under it, which the pose does not report.
    Each consists of the first 75 % of one sweep and the last 75 % of another, which begins at least ``least``
    metres from where the first one ends. Pairs that are closer, or shorter than four samples, are left out.
    """
    sweeps, found = recording.sweeps, []
    for number, before in enumerate(sweeps):
        after = sweeps[(number + len(sweeps) // 2) % len(sweeps)]
        until, since = slice(3 * len(before) // 4), slice(len(after) // 4, None)
        assert before.truth is not None
        assert after.truth is not None
        truth, following = before.truth[until], after.truth[since]
        away = motion.displacement(truth[-1], following[0])
        if min(len(before), len(after)) < 4 or motion.travel(away) < least:
            continue
        stamps, position = before.stamp_ns[until], before.position[until]
        later = after.stamp_ns[since] + (2 * stamps[-1] - stamps[-2] - after.stamp_ns[since][0])
        going_on = after.position[since] + (position[-1] + lifted * away - after.position[since][0])
        found.append(
            RecordedSweep(
                before.number,
                np.concatenate([stamps, later]),
                np.concatenate([position, going_on]),
                np.concatenate([before.strain[until], after.strain[since]]),
                np.concatenate([before.status[until], after.status[since]]),
                np.concatenate([truth, following]),
            )
        )
    return replace(recording, sweeps=tuple(found))


def line_numbers(means: np.ndarray) -> np.ndarray:
    """Number of the line of each sweep, by the order of their mean positions (S, d) across the lines."""
    across = means[:, np.ptp(means, axis=0).argmax()]
    order = across.argsort()
    steps = np.diff(across[order], prepend=across[order[0]])
    line = np.empty(len(means), dtype=int)
    line[order] = np.cumsum(steps > 0.5 * steps.max())
    return line


def find_file(folder: Path, name: str) -> Path | None:
    """A file ``<name>.csv`` or ``<name>.csv.gz``."""
    return next((path for end in (".csv", ".csv.gz") if (path := folder / f"{name}{end}").exists()), None)


class Learned(NamedTuple):
    """A scan, and what was learned from it.

    Parameters
    ----------
    scene, scan, calibration : of the training sweeps
    visit_std, white_std : (C,) V, standard deviations of the noise of a visit, and of the white noise
    learning_s : processor time of the calibration, s
    """

    scene: Scene
    scan: Scan
    calibration: Calibration
    visit_std: np.ndarray
    white_std: np.ndarray
    learning_s: float


def learned_from(folder: Path, variant: Variant) -> Learned:
    """Learn from ``train``.

    Raises
    ------
    ScanError
        The folder lacks the file, or the file a column.
    """
    train = find_file(folder, "train")
    if train is None:
        raise _missing(folder)
    scene = load_scene(folder / "scene.yaml")
    trained = with_passes(load_recording(train, scene), variant.passes, variant.lines)
    visit_std = np.sqrt(whiten(Visits.of(scan_of(trained, scene), scene), Material.SHEET).noise.variance)
    scan = scan_of(with_texture(trained, variant.texture * visit_std), scene)
    began = time.process_time()
    calibration = learn(scan, scene)
    learning_s = time.process_time() - began
    return Learned(scene, scan, calibration, visit_std, white_noise_std(trained), learning_s)


def _missing(folder: Path) -> ScanError:
    return ScanError(f"{folder}: expected train.csv[.gz] and test.csv[.gz]")


def measure_folder(folder: Path, variant: Variant, configuration: Configuration, seed: int) -> list[Row]:
    """The row of one folder, variant and seed.

    Raises
    ------
    ScanError
        The folder lacks a file, or a file a column.
    """
    scene, scan, calibration, visit_std, white_std, learning_s = learned_from(folder, variant)
    test = find_file(folder, "test")
    if test is None:
        raise _missing(folder)
    blank = find_file(folder, "blank")
    added = white_std * np.sqrt(variant.gauge_noise**2 - 1.0)
    added[0] = np.hypot(added[0], variant.noisy_channel * white_std[0])
    localizer = build_localizer(
        scan, scene, configuration, np.random.default_rng(seed), calibration=calibration
    )

    def moved(path: Path, strain_std: np.ndarray, texture: float = 0.0) -> Recording:
        recording = with_texture(load_recording(path, scene), texture * visit_std)
        noisy = with_white_noise(recording, strain_std, np.random.default_rng([seed, 2]))
        return with_displacements(noisy, scene, variant.odometry_noise, seed)

    def replayed(*given: Any) -> list[ReplayedSweep]:
        return replay(localizer, moved(*given))

    def measures(sweeps: Sequence[ReplayedSweep]) -> Row:
        return {**on_feature(sweeps), **falsely_converged(sweeps, radius)}

    radius = configuration.convergence_radius
    recording = moved(test, added, variant.texture)
    sweeps = replay(localizer, recording)
    memory = localizer.model.drift.memory
    row: Row = {
        "folder": folder.name,
        "passes": variant.passes,
        "lines": variant.lines,
        "noise": variant.odometry_noise,
        "gauge": variant.gauge_noise,
        "channel": variant.noisy_channel,
        "texture": variant.texture,
        "seed": seed,
        "sweeps": len(sweeps),
        **measures(sweeps),
        **update_times(sweeps, read_us(scan)),
        "learning_s": learning_s,
        "learned": {
            **learned_values(calibration._asdict()),
            "information_length": calibration.examination.information_length,
            "explanation_length": calibration.examination.explanation_length,
            "memory": memory if np.isfinite(memory) else "constant",
        },
        "standard_errors": standard_errors(measures, sweeps),
        "by_sweep": by_sweep(measures, sweeps),
    }
    for name, lifted in (("again", False), ("set_down", True)):
        placed = replay(localizer, placed_elsewhere(recording, MotionModel(scene), 2.0 * radius, lifted))
        ended = partial(right_at_their_end, radius=radius, name=name)
        row |= ended(placed)
        row["by_sweep"] |= by_sweep(ended, placed)
    if blank is not None:
        row["false_blank"] = ever_converged(replayed(blank, added, variant.texture))
    others = [replayed(path, 0.0 * added) for path in sorted(folder.glob("foreign_*.csv*"))]
    if foreign := [sweep for recording in others for sweep in recording]:
        row |= on_unscanned(foreign)
        row["standard_errors"] |= standard_errors(on_unscanned, foreign)
        row["by_sweep"] |= by_sweep(on_unscanned, foreign)
    return [row]


def localize(
    localizer: Localizer, recording: Recording, odometry_noise: float, seed: int
) -> list[ReplayedSweep]:
    """Localize the sweeps of true positions by noisy displacements, others by their own."""
    return replay(localizer, with_displacements(recording, localizer.scene, odometry_noise, seed))


def with_displacements(recording: Recording, scene: Scene, odometry_noise: float, seed: int) -> Recording:
    """A recording of true positions with noisy displacements, any other one as it is."""
    if all(sweep.truth is not None for sweep in recording.sweeps):
        return recording
    axes = tuple(replace(axis, motion_std=odometry_noise * axis.motion_std) for axis in scene.axes)
    return with_odometry(recording, replace(scene, axes=axes), np.random.default_rng([seed, 1]), SIMULATED)


def learned_values(values: Mapping[str, Any]) -> Row:
    """The numbers and short arrays among learned values, by name; lengths in m."""
    known = {name: np.asarray(value) for name, value in values.items() if value is not None}
    return {
        name: value.round(6).tolist()
        for name, value in known.items()
        if value.dtype.kind in "fi" and value.size <= 8
    }


_NAMES = ("folder", "passes", "lines", "noise", "gauge", "channel", "texture", "seed")


def totals(rows: Sequence[Row]) -> list[Row]:
    """Over all rows: counts summed, other measures averaged."""
    return [{"folder": "all", **summary(rows)}]


def show(rows: Sequence[Row]) -> None:
    """Print the rows, with what of their variants differs, their means, and what was learned."""
    varied = [name for name in _NAMES[1:] if len({row[name] for row in rows}) > 1]
    print_rows(("folder", *varied, "sweeps"), COLUMNS, rows, totals(rows))
    for row in rows:
        learned = ", ".join(f"{name} {value}" for name, value in row["learned"].items())
        print(f"{row['folder']}, passes {row['passes']}, lines {row['lines']}: {learned}")


def main() -> None:
    """Measure, print and write."""
    parser = accuracy_parser(__doc__)
    parser.add_argument("folders", type=Path, nargs="+", metavar="DIR")
    parser.add_argument("--passes", nargs="+", choices=PASSES, default=["both"])
    parser.add_argument("--lines", type=int, nargs="+", default=[1], metavar="K", help="every K-th line")
    parser.add_argument("--odometry-noise", type=float, nargs="+", default=[1.0], metavar="K")
    parser.add_argument("--gauge-noise", type=float, nargs="+", default=[1.0], metavar="FACTOR")
    parser.add_argument("--noisy-channel", type=float, nargs="+", default=[0.0], metavar="WIDTHS")
    parser.add_argument("--texture", type=float, nargs="+", default=[0.0], metavar="WIDTHS")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1], help="of the noise")
    given = parser.parse_args()
    if min(given.gauge_noise) < 1.0:
        parser.error(f"--gauge-noise: expected at least 1, got {min(given.gauge_noise):g}")
    configuration = named_configuration(given.configuration)
    variants = product(*(getattr(given, name) for name in Variant._fields))
    calls = [
        (folder, Variant(*values), configuration, seed)
        for folder, values, seed in product(given.folders, variants, given.seeds)
    ]
    show(measured(measure_folder, calls, given, itemgetter(*_NAMES), totals))


if __name__ == "__main__":
    main()
