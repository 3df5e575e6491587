"""Recordings of a tactile finger that slides along fabric: file names, pairs, reading, perturbation.

Files are named ``<fabric>_F<force>_V<speed>mmps_<repeat>.csv`` and have the columns of
``config/import/fabric_slide.yaml``. The position was not recorded: it is |speed| times the time since the
first sample. A negative speed is the opposite direction, whose recordings need a separate map.
"""

import re
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import ScanError
from tactile_localizer.io.csv.columns import load_naming, naming_from_pairs
from tactile_localizer.io.csv.recording import read_csv
from tactile_localizer.io.recording import RecordedSweep, Recording, join, scan_of
from tactile_localizer.resources import resource_path
from tactile_localizer.scene import Axis, Phalanx, Scene

KINDS = ("own", "speed", "force", "wrong")
"""Difference between a map and a recording: none, speed, force or fabric."""

_MAPPED, _TESTED = (0, 1), 2
"""Repeats of which the map is made, and the one that is localized on it."""

_NAME = re.compile(r"(.+)_F([\d.]+)_V(-?[\d.]+)mmps_(\d+)\.csv")
_PHALANGES = (Phalanx("distal", (0.0,)), Phalanx("proximal", (0.0,)))
_OFFSET_SEED, _NOISE_SEED = 0, 1
_NOISY_CHANNEL = 3
_DRIFT_M = 0.1
"""Travel to which a drift refers, m."""


@dataclass(frozen=True)
class Condition:
    """Recordings of one fabric with one force at one speed.

    Parameters
    ----------
    fabric : name of the fabric
    force : force in the file name
    speed : speed, mm/s; negative in the opposite direction
    files : repeats and their files
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
        """Whether both repeats of a map exist."""
        return set(_MAPPED) <= {repeat for repeat, _ in self.files}

    @property
    def tested(self) -> Path | None:
        """Recording to localize; without a map of the condition, its first one."""
        files = dict(self.files)
        return files.get(_TESTED, None if self.mapped else self.files[0][1])


class Pair(NamedTuple):
    """A map and a recording on it; ``kind`` is one of :data:`KINDS`."""

    map: Condition
    recording: Condition
    kind: str


@dataclass(frozen=True)
class Perturbation:
    """Changes to recordings before they are localized.

    Parameters
    ----------
    drift : offset of the strain, with a fixed random sign per channel, that grows by so many noise widths per
        100 mm of travel, from zero at each start. A noise width is the standard deviation of the difference
        between the map's two repeats
    noisy_channel : standard deviation of white noise on one of the channels, in its noise widths
    """

    drift: float = 0.0
    noisy_channel: float = 0.0

    def of(self, sweep: RecordedSweep, noise_width: np.ndarray) -> RecordedSweep:
        """Add the noise to a recording; ``noise_width`` (16,)."""
        noise = np.random.default_rng(_NOISE_SEED).standard_normal(len(sweep.strain))
        strain = sweep.strain.copy()
        strain[:, _NOISY_CHANNEL] += self.noisy_channel * noise_width[_NOISY_CHANNEL] * noise
        return replace(sweep, strain=strain)

    def drift_per_m(self, noise_width: np.ndarray) -> np.ndarray:
        """Growth of the strain's offset, (16,) per m of travel."""
        signs = np.random.default_rng(_OFFSET_SEED).choice([-1.0, 1.0], len(noise_width))
        return self.drift / _DRIFT_M * noise_width * signs


@dataclass(frozen=True)
class FabricMap:
    """Training scan of a condition, its scene, and its noise.

    Parameters
    ----------
    scan, scene : input of a localizer; the scene has bounds and phalanges only
    length : length of the scan, m
    noise_width : (16,) standard deviation of the difference between the two repeats, counts
    """

    scan: Scan
    scene: Scene
    length: float
    noise_width: np.ndarray


def find_conditions(folder: Path) -> list[Condition]:
    """All conditions in a folder, sorted by name.

    Raises
    ------
    ScanError
        No file in the folder has such a name.
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
    """Pair every map with its own recording, those of other speeds and forces, and those of other fabrics.

    Recordings of another fabric have the speed of the map, or the nearest one.
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
    """Kind of a recording of the same fabric; ``None`` if the direction, or both force and speed, differ."""
    if other.fabric != mapped.fabric:
        return None
    if (other.force, other.speed) == (mapped.force, mapped.speed):
        return "own"
    if other.force == mapped.force and other.speed * mapped.speed > 0:
        return "speed"
    return "force" if other.speed == mapped.speed else None


def load_map(condition: Condition) -> FabricMap:
    """Map of a condition's first two repeats."""
    files = dict(condition.files)
    repeats = [load_sweep(files[repeat], condition.speed) for repeat in _MAPPED]
    length = float(max(repeat.position[-1, 0] for repeat in repeats))
    scene = Scene(condition.name, (Axis("x", 0.0, length),), _PHALANGES)
    scan = scan_of(join([Recording(condition.name, tuple(repeats))]), scene)
    first, second = repeats
    inside = first.position[:, 0] <= second.position[-1, 0]
    there = _interpolated(first.position[inside, 0], second.position[:, 0], second.strain)
    return FabricMap(scan, scene, length, np.std(first.strain[inside] - there, axis=0))


def load_sweep(path: Path, speed: float) -> RecordedSweep:
    """Read a recording made at ``speed`` mm/s.

    Raises
    ------
    ScanError
        The file cannot be read.
    """
    scene = Scene(path.stem, (Axis("x", -1e3, 1e3),), _PHALANGES)
    naming = load_naming(resource_path("config/import/fabric_slide.yaml"))
    naming = naming_from_pairs([f"x=timestamp*{1e-6 * abs(speed):.9g}"], naming)
    (sweep,) = read_csv(path, scene, naming).sweeps
    return sweep.part(np.isfinite(sweep.strain).all(axis=1), sweep.number)


def cut(sweep: RecordedSweep, begin: float, end: float) -> RecordedSweep:
    """Samples of a recording between two positions, m."""
    return sweep.part(slice(*np.searchsorted(sweep.position[:, 0], (begin, end))), sweep.number)


def _interpolated(at: np.ndarray, known: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Columns of ``values`` at positions ``at``, interpolated linearly between the ``known`` ones."""
    return np.column_stack([np.interp(at, known, column) for column in values.T])
