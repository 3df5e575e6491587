"""Recordings in CSV: one row a sample, one sweep a file or as a column says.

Standard columns: ``stamp_s, sweep, <axis>..., <phalanx>_1, <phalanx>_2, ...`` in SI units, and, where it is
known, ``felt``: 1 from contact with a feature to its end. Other names and units by a
:class:`~tactile_localizer.io.csv.columns.ColumnNaming`, position from constant speed where nothing recorded
it. A row that cannot be used is counted and reported. Rows that run backwards in time are sorted by their
stamps.
"""

from __future__ import annotations

import math
import reprlib
from bisect import bisect_left
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from pathlib import Path

import numpy as np

from tactile_localizer.core.geometry.pose_buffer import near_bounds
from tactile_localizer.errors import ScanError
from tactile_localizer.io.csv.columns import ANGLES, LENGTHS, TIMES, ColumnNaming, fitting_unit, inside
from tactile_localizer.io.csv.table import listed, read_table
from tactile_localizer.io.recording import RecordedSweep, Recording, join, missing_status
from tactile_localizer.scene import Axis, Scene

_FELT = "felt"
_NOT_NUMBERS = "not numbers"
_NOT_FINITE = "with a position that is not finite"
_OUT_OF_ORDER = "with a stamp out of order"
_TOO_LARGE = "with a stamp that is too large (in ms? --column stamp_s=NAME*0.001)"
_MOST = 2**62
_MOST_RADIANS = 4 * math.pi
_BACKWARDS = 0.25
"""Share of the steps between stamps that go back from which rows are sorted: one recording after another
in a file has few such steps, rows in reverse or in no order have many."""


def read_csv(
    paths: str | Path | Sequence[str | Path],
    scene: Scene,
    naming: ColumnNaming | None = None,
    speed: Mapping[str, float] | None = None,
) -> Recording:
    """Read one or several CSV files as one recording.

    Parameters
    ----------
    paths : the files; each is one sweep unless it has a column ``sweep``
    scene : names the axes and phalanges that are read
    naming : columns that do not have the standard names
    speed : by axis, m/s (rad/s): position there is speed x (stamp - first stamp of the sweep); with a
        negative speed, where the bounds lie above 0, the sweep runs back over the same stretch and ends at 0

    Returns
    -------
    Recording
        Positions as recorded; values that are not finite are NaN with status MISSING. The notes
        count the rows that could not be read.

    Raises
    ------
    ScanError
        A file cannot be read, lacks a column, or has no row that can be used.
    """
    naming = naming or ColumnNaming()
    naming = replace(naming, speed={**naming.speed, **(speed or {})})
    naming.check(scene)
    files = [paths] if isinstance(paths, str | Path) else paths
    return join([_read_file(Path(path), scene, naming) for path in files])


def _read_file(path: Path, scene: Scene, naming: ColumnNaming) -> Recording:
    speed = naming.speed
    rows = _read_rows(path, scene, naming, speed)
    sweeps = tuple(_sweep(number, samples, scene, speed) for number, samples in rows.by_sweep.items())
    return Recording(
        str(path),
        scene.axis_names,
        scene.phalanx_names,
        sweeps,
        (*rows.notes(path), *_unit_notes(path, rows, scene, naming, speed)),
        scene.layout.counts,
        rows.bad.total(),
    )


@dataclass(frozen=True)
class _Sample:
    """A row that could be read: positions that are columns, strain, in the order of the scene; felt."""

    line: int
    stamp_ns: int
    values: list[float]


@dataclass
class _Rows:
    """The rows of one file that could be read, by sweep number."""

    by_sweep: dict[int, list[_Sample]] = field(default_factory=dict)
    total: int = 0
    bad: Counter[str] = field(default_factory=Counter)
    first: dict[str, str] = field(default_factory=dict)  # by reason, where
    sorted_sweeps: list[int] = field(default_factory=list)

    def reject(self, reason: str, line: int, what: str = "") -> None:
        self.bad[reason] += 1
        self.first.setdefault(reason, f"line {line}{what}")

    def left_out(self) -> str:
        return ", ".join(
            f"{count} {reason} (first: {self.first[reason]})" for reason, count in self.bad.items()
        )

    def notes(self, path: Path) -> Iterator[str]:
        if self.bad:
            yield f"{path}: left out {self.bad.total()} of {self.total} rows: {self.left_out()}"
        if self.sorted_sweeps:
            yield f"{path}: sorted {len(self.sorted_sweeps)} sweeps by their stamps, which run backwards"


def _read_rows(path: Path, scene: Scene, naming: ColumnNaming, speed: Mapping[str, float]) -> _Rows:
    rows = _Rows()
    table = read_table(path)
    _, header = next(table, (0, []))
    picker = _Picker.of(path, [name.strip() for name in header], scene, naming, speed)
    for line, cells in table:
        rows.total += 1
        try:
            number, stamp_ns, values = picker.pick(cells)
        except OverflowError:
            rows.reject(_TOO_LARGE, line)
            continue
        except (ValueError, ArithmeticError, IndexError):
            rows.reject(_NOT_NUMBERS, line, picker.culprit(cells))
            continue
        if not all(map(math.isfinite, values[: picker.positions])):
            rows.reject(_NOT_FINITE, line)
            continue
        rows.by_sweep.setdefault(number, []).append(_Sample(line, stamp_ns, values))
    if not rows.by_sweep:
        raise ScanError(
            f"{path}: expected rows of numbers, found none in {rows.total} rows"
            + (f": {rows.left_out()}" if rows.bad else "")
        )
    for number, samples in rows.by_sweep.items():
        stamps = np.array([sample.stamp_ns for sample in samples])
        if len(samples) > 1 and np.mean(np.diff(stamps) < 0) >= _BACKWARDS:
            samples = [samples[index] for index in np.argsort(stamps, kind="stable").tolist()]
            rows.sorted_sweeps.append(number)
        kept = _longest_in_order([sample.stamp_ns for sample in samples])
        rows.by_sweep[number] = [samples[index] for index in kept]
        for index in sorted(set(range(len(samples))) - set(kept)):
            rows.reject(_OUT_OF_ORDER, samples[index].line)
    return rows


def _unit_notes(
    path: Path, rows: _Rows, scene: Scene, naming: ColumnNaming, speed: Mapping[str, float]
) -> Iterator[str]:
    """Units in which the positions of an axis that mostly lie outside its bounds would lie inside."""
    recorded = [axis for axis in scene.axis_names if axis not in speed]
    for axis in scene.axes:
        if axis.name in speed:
            parts = [_travelled(own, speed[axis.name], axis) for own in rows.by_sweep.values()]
            found = fitting_unit(axis, np.concatenate(parts), TIMES)
            quantity, name = "stamp_s", naming.of("stamp_s")
        else:
            column = recorded.index(axis.name)
            values = np.array([sample.values[column] for own in rows.by_sweep.values() for sample in own])
            if axis.name == "yaw" and _are_radians(axis, values):
                continue
            found = fitting_unit(axis, values, ANGLES if axis.name == "yaw" else LENGTHS)
            quantity, name = axis.name, naming.of(axis.name)
        if found is not None:
            unit, factor = found
            scale = f"{float(name.scale) * factor:.6g}"
            yield f"{path}: {quantity} seems to be in {unit}: --column {quantity}={name.names[0]}*{scale}"


def _are_radians(axis: Axis, values: np.ndarray) -> bool:
    """Whether angles (n,) lie within few turns and, but for whole turns, mostly inside the bounds."""
    wrapped = near_bounds((axis,), values[:, None])[:, 0]
    return float(np.abs(values).max()) <= _MOST_RADIANS and inside(axis, wrapped) >= 0.5


def _travelled(samples: Sequence[_Sample], speed: float, axis: Axis) -> np.ndarray:
    """Positions from constant speed, (n,) m (rad): the lower end is 0 where the bounds lie above 0."""
    stamp_ns = np.array([sample.stamp_ns for sample in samples], dtype=np.int64)
    ends_at_zero = speed < 0 < axis.lower + axis.upper
    return np.asarray(speed * (stamp_ns - stamp_ns[-1 if ends_at_zero else 0]) * 1e-9)


def _longest_in_order(stamps: list[int]) -> list[int]:
    """Indices of the longest rising sequence: so the fewest stamps that are not in order are left out."""
    ends: list[int] = []  # the least stamp that a rising sequence of each length ends with, and its index
    indices: list[int] = []
    before: list[int] = []  # for each stamp, the index of the one before it in its sequence
    for index, stamp in enumerate(stamps):
        length = bisect_left(ends, stamp)
        before.append(indices[length - 1] if length else -1)
        if length == len(ends):
            ends.append(stamp)
            indices.append(index)
        elif stamp < ends[length]:  # of equal ones the first stays
            ends[length], indices[length] = stamp, index
    kept = []
    index = indices[-1] if indices else -1
    while index >= 0:
        kept.append(index)
        index = before[index]
    return kept[::-1]


@dataclass(frozen=True)
class _Picker:
    """Takes the wanted values out of a row."""

    columns: tuple[str, ...]
    stamp_index: int
    nanoseconds: Decimal
    sweep_index: int | None
    indices: tuple[int, ...]
    scales: tuple[float, ...]
    positions: int

    @classmethod
    def of(
        cls, path: Path, header: list[str], scene: Scene, naming: ColumnNaming, speed: Mapping[str, float]
    ) -> _Picker:
        channels = {phalanx.name: phalanx.channels for phalanx in scene.phalanges}

        def find(quantity: str, name: str) -> int:
            if header.count(name) != 1:
                several = f"1..{channels[quantity]}" if quantity in channels else ""
                hint = f"--column {quantity}=NAME{several}"
                found = listed(header) or "no header"
                article = "one" if name in header else "a"
                raise ScanError(f"{path}: expected {article} column {name!r} (or {hint}), found {found}")
            return header.index(name)

        stamp = naming.of("stamp_s")
        axes = {axis: naming.of(axis) for axis in scene.axis_names if axis not in speed}
        wanted = {**axes, **{phalanx.name: naming.of_phalanx(phalanx) for phalanx in scene.phalanges}}
        sweep = naming.of("sweep").names[0]
        has_sweep = sweep in header or "sweep" in naming.columns
        return cls(
            columns=tuple(header),
            stamp_index=find("stamp_s", stamp.names[0]),
            nanoseconds=stamp.scale * 10**9,
            sweep_index=find("sweep", sweep) if has_sweep else None,
            indices=(
                *(find(what, name) for what, columns in wanted.items() for name in columns.names),
                *((header.index(_FELT),) if header.count(_FELT) == 1 else ()),
            ),
            scales=(*(float(columns.scale) for columns in wanted.values() for _ in columns.names), 1.0),
            positions=len(axes),
        )

    def pick(self, row: list[str]) -> tuple[int, int, list[float]]:
        """Sweep number, stamp in ns, values; raises what ``float`` and ``Decimal`` raise."""
        # A binary float would lose up to 0.2 us of a stamp that counts from 1970.
        stamp_ns = int((Decimal(row[self.stamp_index]) * self.nanoseconds).to_integral_value())
        number = 1.0 if self.sweep_index is None else float(row[self.sweep_index])
        if not abs(number) <= _MOST:
            raise ValueError
        if abs(stamp_ns) > _MOST:
            raise OverflowError
        values = [float(row[index]) * scale for index, scale in zip(self.indices, self.scales, strict=False)]
        return int(number), stamp_ns, values

    def culprit(self, row: list[str]) -> str:
        """Which cell of a row that could not be picked is to blame."""
        sweep = () if self.sweep_index is None else (self.sweep_index,)
        for index in (self.stamp_index, *sweep, *self.indices):
            if index >= len(row):
                return f", {len(row)} cells"
            try:
                int(float(row[index])) if index in sweep else float(row[index])
            except (ValueError, OverflowError):
                return f", {listed([self.columns[index]])} {reprlib.repr(row[index])}"
        return ""


def _sweep(
    number: int, samples: Sequence[_Sample], scene: Scene, speed: Mapping[str, float]
) -> RecordedSweep:
    stamp_ns = np.array([sample.stamp_ns for sample in samples], dtype=np.int64)
    values = np.array([sample.values for sample in samples])
    recorded = [axis for axis in scene.axis_names if axis not in speed]
    columns = dict(zip(recorded, values.T, strict=False))
    position = np.column_stack(
        [
            columns[axis.name] if axis.name in columns else _travelled(samples, speed[axis.name], axis)
            for axis in scene.axes
        ]
    )
    strain, felt = np.split(values[:, len(recorded) :], [scene.layout.size], axis=1)
    strain[~np.isfinite(strain)] = math.nan
    status = missing_status(strain, scene.layout)
    return RecordedSweep(
        number,
        stamp_ns,
        near_bounds(scene.axes, position),
        strain,
        status,
        felt=felt[:, 0] > 0.0 if felt.size else None,
    )
