"""Recordings of a tactile finger that slides along fabric: found by file name, paired, read, perturbed.

A file is ``<fabric>_F<force>_V<speed>mmps_<repeat>.csv``, its columns are those of
``config/import/fabric_slide.yaml``. Nothing recorded the position: it is |speed| times the time since the
first sample. A negative speed slides the other way, so that its recordings never share a map with those of
a positive one.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import ScanError
from tactile_localizer.io.csv.columns import load_naming
from tactile_localizer.io.csv.recording import read_csv
from tactile_localizer.resources import resource_path
from tactile_localizer.scene import Axis, Phalanx, Scene

KINDS = ("own", "speed", "force", "wrong")
"""What differs between a map and a recording: nothing, the speed, the force, the fabric."""

_MAPPED, _TESTED = (0, 1), 2
"""Repeats that make a map, and the one that is localized on it."""

_NAME = re.compile(r"(.+)_F([\d.]+)_V(-?[\d.]+)mmps_(\d+)\.csv")
_PHALANGES = (Phalanx("distal", (0.0,)), Phalanx("proximal", (0.0,)))
_OFFSET_SEED = 0


@dataclass(frozen=True)
class Condition:
    """One fabric under one force at one speed.

    Parameters
    ----------
    fabric : its name
    force : as the file name gives it
    speed : mm/s, negative where the finger slides the other way
    files : by repeat
    """

    fabric: str
    force: float
    speed: float
    files: tuple[tuple[int, Path], ...]

    @property
    def name(self) -> str:
        """``<fabric>_F<force>_V<speed>``."""
        return f"{self.fabric}_F{self.force:g}_V{self.speed:g}"

    @property
    def mapped(self) -> bool:
        """Whether it has both repeats that make a map."""
        return set(_MAPPED) <= {repeat for repeat, _ in self.files}

    @property
    def tested(self) -> Path | None:
        """The recording that is localized; of a condition that cannot be mapped, its first one."""
        files = dict(self.files)
        return files.get(_TESTED, None if self.mapped else self.files[0][1])


class Pair(NamedTuple):
    """A map and a recording on it; ``kind`` is one of :data:`KINDS`."""

    map: Condition
    recording: Condition
    kind: str


@dataclass(frozen=True)
class Sweep:
    """One recording: n samples along the fabric.

    Parameters
    ----------
    stamp_ns : (n,) int64
    position : (n,) m
    strain : (n, 16) counts
    """

    stamp_ns: np.ndarray
    position: np.ndarray
    strain: np.ndarray


@dataclass(frozen=True)
class Perturbation:
    """What differs between the scan and its use, beyond the condition.

    Parameters
    ----------
    every : only each such sample of a recording is used
    resample_hz : recordings are interpolated linearly to this rate; ``None``: as recorded
    speed : recordings are replayed so many times as fast: the same samples, their stamps closer together
    scale : all strains, also the map's, are multiplied by this
    offset : added to all strains of a recording, each channel with a random sign that is always the same, in
        noise widths: standard deviations of the difference of the map's two repeats
    tared : recordings of another fabric get the mean strain of the map
    """

    every: int = 1
    resample_hz: float | None = None
    speed: float = 1.0
    scale: float = 1.0
    offset: float = 0.0
    tared: bool = False

    def of(self, sweep: Sweep, noise_width: np.ndarray) -> Sweep:
        """A recording as it is used; ``noise_width`` (16,) is of strains that are not scaled yet."""
        signs = np.random.default_rng(_OFFSET_SEED).choice([-1.0, 1.0], sweep.strain.shape[1])
        strain = self.scale * (sweep.strain + self.offset * signs * noise_width)
        since_ns = np.round((sweep.stamp_ns - sweep.stamp_ns[0]) / self.speed)
        used = Sweep(since_ns.astype(np.int64), sweep.position, strain)
        used = Sweep(used.stamp_ns[:: self.every], used.position[:: self.every], strain[:: self.every])
        return used if self.resample_hz is None else _resampled(used, self.resample_hz)


@dataclass(frozen=True)
class FabricMap:
    """The training scan of a condition, its scene of bounds and phalanges alone, and its noise.

    Parameters
    ----------
    scan, scene : what a localizer is built from
    length : m, of the scan
    noise_width : (16,) counts, standard deviation of the difference of the two repeats
    """

    scan: Scan
    scene: Scene
    length: float
    noise_width: np.ndarray


def find_conditions(folder: Path) -> list[Condition]:
    """All conditions of a folder, by name.

    Raises
    ------
    ScanError
        No file of the folder has such a name.
    """
    files: dict[tuple[str, float, float], list[tuple[int, Path]]] = defaultdict(list)
    for path in sorted(folder.glob("*.csv")):
        if match := _NAME.fullmatch(path.name):
            fabric, force, speed, repeat = match.groups()
            files[fabric, float(force), float(speed)].append((int(repeat), path))
    if not files:
        raise ScanError(f"{folder}: expected files <fabric>_F<force>_V<speed>mmps_<repeat>.csv, found none")
    conditions = [Condition(*key, tuple(sorted(own))) for key, own in files.items()]
    return sorted(conditions, key=lambda condition: condition.name)


def find_pairs(conditions: Iterable[Condition]) -> list[Pair]:
    """Every map with its own recording, those of other speeds and forces, and those of other fabrics.

    Of another fabric the recordings of the map's speed count; where it has none, those of the nearest speed.
    """
    tested = [condition for condition in conditions if condition.tested is not None]
    pairs = []
    for mapped in (condition for condition in conditions if condition.mapped):
        pairs += [Pair(mapped, other, kind) for other in tested if (kind := _kind(mapped, other)) is not None]
        for fabric in sorted({other.fabric for other in tested} - {mapped.fabric}):
            own = [other for other in tested if other.fabric == fabric]
            nearest = min(abs(other.speed - mapped.speed) for other in own)
            pairs += [
                Pair(mapped, other, "wrong") for other in own if abs(other.speed - mapped.speed) == nearest
            ]
    return pairs


def _kind(mapped: Condition, other: Condition) -> str | None:
    """Kind of a recording of the same fabric; ``None`` where direction, or both force and speed differ."""
    if other.fabric != mapped.fabric:
        return None
    if (other.force, other.speed) == (mapped.force, mapped.speed):
        return "own"
    if other.force == mapped.force and other.speed * mapped.speed > 0:
        return "speed"
    return "force" if other.speed == mapped.speed else None


def load_map(condition: Condition, scale: float = 1.0) -> FabricMap:
    """The map of a condition's first two repeats, strains multiplied by ``scale``."""
    files = dict(condition.files)
    repeats = [load_sweep(files[repeat], condition.speed) for repeat in _MAPPED]
    length = float(max(repeat.position[-1] for repeat in repeats))
    axis = Axis("x", 0.0, length)
    scene = Scene(condition.name, (axis,), _PHALANGES)
    scan = Scan(
        states=np.concatenate([repeat.position for repeat in repeats])[:, None],
        strain=scale * np.concatenate([repeat.strain for repeat in repeats]),
        sweep=np.repeat(np.arange(len(repeats)), [len(repeat.position) for repeat in repeats]),
        axes=scene.axis_names,
        phalanges=scene.phalanx_names,
    )
    first, second = repeats
    inside = first.position <= second.position[-1]
    there = _interpolated(first.position[inside], second.position, second.strain)
    return FabricMap(scan, scene, length, np.std(first.strain[inside] - there, axis=0))


def load_sweep(path: Path, speed: float) -> Sweep:
    """A recording at ``speed`` mm/s.

    Raises
    ------
    ScanError
        The file cannot be read.
    """
    scene = Scene(path.stem, (Axis("x", -1e3, 1e3),), _PHALANGES)
    naming = load_naming(resource_path("config/import/fabric_slide.yaml"))
    (sweep,) = read_csv(path, scene, naming, {"x": 1e-3 * abs(speed)}).sweeps
    felt = np.isfinite(sweep.strain).all(axis=1)
    return Sweep(sweep.stamp_ns[felt], sweep.position[felt, 0], sweep.strain[felt])


def cut(sweep: Sweep, begin: float, end: float) -> Sweep:
    """The samples of a recording between two positions, m."""
    part = slice(*np.searchsorted(sweep.position, (begin, end)))
    return replace(
        sweep, stamp_ns=sweep.stamp_ns[part], position=sweep.position[part], strain=sweep.strain[part]
    )


def _resampled(sweep: Sweep, rate_hz: float) -> Sweep:
    stamp_ns = np.arange(0, sweep.stamp_ns[-1] + 1, 1e9 / rate_hz).astype(np.int64)
    position = np.interp(stamp_ns, sweep.stamp_ns, sweep.position)
    return Sweep(stamp_ns, position, _interpolated(stamp_ns, sweep.stamp_ns, sweep.strain))


def _interpolated(at: np.ndarray, known: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Columns of ``values`` at places ``at``, linear between the ``known`` ones."""
    return np.column_stack([np.interp(at, known, column) for column in values.T])
