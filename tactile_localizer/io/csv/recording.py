"""Reading CSV files as a recording: one row per sample, one sweep per file or per value of a column.

Standard columns are ``stamp_s, sweep, <axis>..., <phalanx>_1, <phalanx>_2, ...`` in SI units, and, where it
is known, ``felt``: 1 from contact with a feature to its end. A
:class:`~tactile_localizer.io.csv.columns.ColumnNaming` gives other names and units, and a constant speed
for positions that were not recorded. Invalid rows are skipped, counted and reported. Rows in reverse order
of time are sorted by their stamps.
"""

from __future__ import annotations

import math
import reprlib
from bisect import bisect_left
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path

import numpy as np

from tactile_localizer.core.geometry.pose_buffer import near_bounds
from tactile_localizer.errors import ScanError
from tactile_localizer.io.csv.columns import (
    ANGLES,
    LENGTHS,
    SI_INSIDE_FRACTION,
    TIMES,
    ColumnNaming,
    fitting_unit,
    inside,
)
from tactile_localizer.io.csv.table import listed, read_table
from tactile_localizer.io.recording import RecordedSweep, Recording, join, missing_status
from tactile_localizer.scene import Axis, Scene

_FELT = "felt"
_NOT_NUMBERS = "not numbers"
_NOT_FINITE = "with a position that is not finite"
_OUT_OF_ORDER = "with a stamp out of order"
_TOO_LARGE = "with a stamp that is too large (in ms? --column stamp_s=NAME*0.001)"
_MAX_MAGNITUDE = 2**62
"""Largest sweep number and stamp, ns: their differences fit into 64 bits."""

_MAX_RADIANS = 4 * math.pi
"""Largest yaw that is taken to be in rad: a hand turns less than two revolutions (judgement)."""

_SORT_BACKWARD_FRACTION = 0.25
"""Fraction of backward steps between stamps from which rows are sorted (judgement).

Consecutive recordings in one file have few such steps; rows in reverse or arbitrary order have many.
"""


def read_csv(
    paths: str | Path | Sequence[str | Path],
    scene: Scene,
    naming: ColumnNaming | None = None,
) -> Recording:
    """Read one or several CSV files as one recording.

    Parameters
    ----------
    paths : the files; each is one sweep unless it has a column ``sweep``
    scene : axes and phalanges to read
    naming : columns with other than the standard names, and constant speeds

    Returns
    -------
    Recording
        Recorded positions; strain that is not finite is NaN with status MISSING. The notes count the
        skipped rows.

    Raises
    ------
    ScanError
        A file cannot be read, lacks a column, or has no valid row.
    """
    naming = naming or ColumnNaming()
    naming.check(scene)
    files = [paths] if isinstance(paths, str | Path) else paths
    return join([_read_file(Path(path), scene, naming) for path in files])


def _read_file(path: Path, scene: Scene, naming: ColumnNaming) -> Recording:
    rows = _read_rows(path, scene, naming)
    sweeps = tuple(_sweep(number, samples, scene, naming) for number, samples in rows.by_sweep.items())
    return Recording(
        str(path),
        scene.axis_names,
        scene.phalanx_names,
        sweeps,
        (*rows.notes(path), *_unit_notes(path, rows, scene, naming)),
        scene.layout.counts,
        rows.bad.total(),
    )


@dataclass(frozen=True)
class _Sample:
    """A valid row: recorded positions, then strain, in the order of the scene; felt."""

    line: int
    stamp_ns: int
    values: list[float]


@dataclass
class _Rows:
    """Valid rows of one file by sweep number, and counts of the invalid ones by reason."""

    by_sweep: dict[int, list[_Sample]] = field(default_factory=dict)
    total: int = 0
    bad: Counter[str] = field(default_factory=Counter)
    first: dict[str, str] = field(default_factory=dict)  # by reason, where
    sorted_sweeps: list[int] = field(default_factory=list)

    def reject(self, reason: str, line: int, what: str = "") -> None:
        self.bad[reason] += 1
        self.first.setdefault(reason, f"line {line}{what}")

    def skipped(self) -> str:
        return ", ".join(
            f"{count} {reason} (first: {self.first[reason]})" for reason, count in self.bad.items()
        )

    def notes(self, path: Path) -> Iterator[str]:
        if self.bad:
            yield f"{path}: skipped {self.bad.total()} of {self.total} rows: {self.skipped()}"
        if self.sorted_sweeps:
            yield f"{path}: sorted {len(self.sorted_sweeps)} sweeps with backward stamps by their stamps"


def _read_rows(path: Path, scene: Scene, naming: ColumnNaming) -> _Rows:
    rows = _Rows()
    table = read_table(path)
    _, header = next(table, (0, []))
    picker = _Picker.of(path, [name.strip() for name in header], scene, naming)
    for line, cells in table:
        rows.total += 1
        try:
            number, stamp_ns, values = picker.pick(cells)
        except OverflowError:
            rows.reject(_TOO_LARGE, line)
            continue
        except (ValueError, ArithmeticError, IndexError):
            rows.reject(_NOT_NUMBERS, line, picker.invalid_cell(cells))
            continue
        if not all(map(math.isfinite, values[: picker.positions])):
            rows.reject(_NOT_FINITE, line)
            continue
        rows.by_sweep.setdefault(number, []).append(_Sample(line, stamp_ns, values))
    if not rows.by_sweep:
        raise ScanError(
            f"{path}: expected rows of numbers, found none in {rows.total} rows"
            + (f": {rows.skipped()}" if rows.bad else "")
        )
    for number, samples in rows.by_sweep.items():
        stamps = np.array([sample.stamp_ns for sample in samples])
        if len(samples) > 1 and np.mean(np.diff(stamps) < 0) >= _SORT_BACKWARD_FRACTION:
            samples = [samples[index] for index in np.argsort(stamps, kind="stable").tolist()]
            rows.sorted_sweeps.append(number)
        kept = _longest_in_order([sample.stamp_ns for sample in samples])
        rows.by_sweep[number] = [samples[index] for index in kept]
        for index in sorted(set(range(len(samples))) - set(kept)):
            rows.reject(_OUT_OF_ORDER, samples[index].line)
    return rows


def _unit_notes(path: Path, rows: _Rows, scene: Scene, naming: ColumnNaming) -> Iterator[str]:
    """Hints at units that would bring positions inside the bounds, for axes with most positions outside."""
    recorded = [axis for axis in scene.axis_names if axis not in naming.speed]
    for axis in scene.axes:
        if axis.name in naming.speed:
            parts = [_travelled(samples, naming.speed[axis.name], axis) for samples in rows.by_sweep.values()]
            found = fitting_unit(axis, np.concatenate(parts), TIMES)
            quantity, name = "stamp_s", naming.of("stamp_s")
        else:
            column = recorded.index(axis.name)
            values = np.array(
                [sample.values[column] for samples in rows.by_sweep.values() for sample in samples]
            )
            if axis.name == "yaw" and _are_radians(axis, values):
                continue
            found = fitting_unit(axis, values, ANGLES if axis.name == "yaw" else LENGTHS)
            quantity, name = axis.name, naming.of(axis.name)
        if found is not None:
            unit, factor = found
            scale = f"{float(name.scale) * factor:.6g}"
            yield f"{path}: {quantity} seems to be in {unit}: --column {quantity}={name.names[0]}*{scale}"


def _are_radians(axis: Axis, values: np.ndarray) -> bool:
    """Whether angles (n,) are of plausible size in rad and, modulo 2 pi, mostly inside the bounds."""
    wrapped = near_bounds((axis,), values[:, None])[:, 0]
    return float(np.abs(values).max()) <= _MAX_RADIANS and inside(axis, wrapped) >= SI_INSIDE_FRACTION


def _travelled(samples: Sequence[_Sample], speed: float, axis: Axis) -> np.ndarray:
    """Positions at constant speed, (n,) m (rad), from 0 or, with negative speed, to 0."""
    stamp_ns = np.array([sample.stamp_ns for sample in samples], dtype=np.int64)
    ends_at_zero = speed < 0 < axis.lower + axis.upper
    return np.asarray(speed * (stamp_ns - stamp_ns[-1 if ends_at_zero else 0]) * 1e-9)


def _longest_in_order(stamps: list[int]) -> list[int]:
    """Indices of the longest increasing subsequence, which skips as few stamps as possible."""
    ends: list[int] = []  # smallest last stamp of an increasing subsequence of each length
    indices: list[int] = []  # index of that stamp
    before: list[int] = []  # for each stamp, the index of its predecessor
    for index, stamp in enumerate(stamps):
        length = bisect_left(ends, stamp)
        before.append(indices[length - 1] if length else -1)
        if length == len(ends):
            ends.append(stamp)
            indices.append(index)
        elif stamp < ends[length]:  # the first of equal stamps is kept
            ends[length], indices[length] = stamp, index
    kept = []
    index = indices[-1] if indices else -1
    while index >= 0:
        kept.append(index)
        index = before[index]
    return kept[::-1]


@dataclass(frozen=True)
class _Picker:
    """Extracts the required values from a row."""

    columns: tuple[str, ...]
    stamp_index: int
    nanoseconds: Decimal
    sweep_index: int | None
    indices: tuple[int, ...]
    scales: tuple[float, ...]
    positions: int

    @classmethod
    def of(cls, path: Path, header: list[str], scene: Scene, naming: ColumnNaming) -> _Picker:
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
        axes = {axis: naming.of(axis) for axis in scene.axis_names if axis not in naming.speed}
        required = {**axes, **{phalanx.name: naming.of_phalanx(phalanx) for phalanx in scene.phalanges}}
        sweep = naming.of("sweep").names[0]
        has_sweep = sweep in header or "sweep" in naming.columns
        return cls(
            columns=tuple(header),
            stamp_index=find("stamp_s", stamp.names[0]),
            nanoseconds=stamp.scale * 10**9,
            sweep_index=find("sweep", sweep) if has_sweep else None,
            indices=(
                *(find(what, name) for what, columns in required.items() for name in columns.names),
                *((header.index(_FELT),) if header.count(_FELT) == 1 else ()),
            ),
            scales=(*(float(columns.scale) for columns in required.values() for _ in columns.names), 1.0),
            positions=len(axes),
        )

    def pick(self, row: list[str]) -> tuple[int, int, list[float]]:
        """Sweep number, stamp (ns) and values; raises the exceptions of ``float`` and ``Decimal``."""
        # A binary float would lose up to 0.2 µs of a stamp since 1970.
        stamp_ns = int((Decimal(row[self.stamp_index]) * self.nanoseconds).to_integral_value())
        number = 1.0 if self.sweep_index is None else float(row[self.sweep_index])
        if not abs(number) <= _MAX_MAGNITUDE:
            raise ValueError
        if abs(stamp_ns) > _MAX_MAGNITUDE:
            raise OverflowError
        values = [float(row[index]) * scale for index, scale in zip(self.indices, self.scales, strict=False)]
        return int(number), stamp_ns, values

    def invalid_cell(self, row: list[str]) -> str:
        """Description of the first invalid cell of a row."""
        sweep = () if self.sweep_index is None else (self.sweep_index,)
        for index in (self.stamp_index, *sweep, *self.indices):
            if index >= len(row):
                return f", {len(row)} cells"
            try:
                int(float(row[index])) if index in sweep else float(row[index])
            except (ValueError, OverflowError):
                return f", {listed([self.columns[index]])} {reprlib.repr(row[index])}"
        return ""


def _sweep(number: int, samples: Sequence[_Sample], scene: Scene, naming: ColumnNaming) -> RecordedSweep:
    stamp_ns = np.array([sample.stamp_ns for sample in samples], dtype=np.int64)
    values = np.array([sample.values for sample in samples])
    recorded = [axis for axis in scene.axis_names if axis not in naming.speed]
    columns = dict(zip(recorded, values.T, strict=False))
    position = np.column_stack(
        [
            columns[axis.name] if axis.name in columns else _travelled(samples, naming.speed[axis.name], axis)
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
