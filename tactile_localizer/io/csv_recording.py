"""Recordings in CSV: one row a sample, one sweep a file or as a column says.

Standard columns: ``stamp_s, sweep, <axis>..., <phalanx>_1..<phalanx>_8`` in SI units; other names and
units by a :class:`~tactile_localizer.io.csv_columns.ColumnNaming`, position from constant speed where
nothing recorded it. A row that cannot be used is counted and said, never fatal.
"""

from __future__ import annotations

import csv
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal, InvalidOperation
from pathlib import Path

import numpy as np

from tactile_localizer.core.pose_buffer import near_bounds
from tactile_localizer.errors import ScanError
from tactile_localizer.io.csv_columns import ColumnNaming
from tactile_localizer.io.recording import RecordedSweep, Recording, join, missing_status
from tactile_localizer.scene import Scene

_NOT_NUMBERS = "not numbers"
_NOT_FINITE = "with a position that is not finite"
_NOT_LATER = "with a stamp not later than the one before"
_MAX_NS = 2**63 - 1


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
    speed : by axis, m/s (rad/s): position there is speed x (stamp - first stamp of the sweep)

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
    naming.check(scene)
    speed = speed or {}
    for axis in speed:
        if axis not in scene.axis_names:
            raise ScanError(f"speed of axis {axis!r}: expected one of {', '.join(scene.axis_names)}")
    files = [paths] if isinstance(paths, str | Path) else paths
    return join([_read_file(Path(path), scene, naming, speed) for path in files])


def _read_file(path: Path, scene: Scene, naming: ColumnNaming, speed: Mapping[str, float]) -> Recording:
    rows = _read_rows(path, scene, naming, speed)
    sweeps = tuple(_sweep(number, samples, scene, speed) for number, samples in rows.by_sweep.items())
    return Recording(str(path), scene.axis_names, scene.phalanx_names, sweeps, tuple(rows.notes(path)))


@dataclass
class _Rows:
    """The rows of one file that could be read, by sweep number."""

    by_sweep: dict[int, list[tuple[int, list[float]]]] = field(default_factory=dict)
    total: int = 0
    bad: Counter[str] = field(default_factory=Counter)
    first_bad_line: dict[str, int] = field(default_factory=dict)

    def reject(self, reason: str, line: int) -> None:
        self.bad[reason] += 1
        self.first_bad_line.setdefault(reason, line)

    def notes(self, path: Path) -> Iterator[str]:
        if self.bad:
            reasons = ", ".join(
                f"{count} {reason} (first: line {self.first_bad_line[reason]})"
                for reason, count in self.bad.items()
            )
            yield f"{path}: left out {self.bad.total()} of {self.total} rows: {reasons}"


def _read_rows(path: Path, scene: Scene, naming: ColumnNaming, speed: Mapping[str, float]) -> _Rows:
    """Rows as stamp and values: positions that are columns, then strain, in the order of the scene."""
    rows = _Rows()
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file, skipinitialspace=True)
            header = [name.strip() for name in next(reader, [])]
            picker = _Picker.of(path, header, scene, naming, speed)
            latest: dict[int, int] = {}
            for row in reader:
                if not row:
                    continue
                rows.total += 1
                try:
                    number, stamp_ns, values = picker.pick(row)
                except (ValueError, ArithmeticError, IndexError):
                    rows.reject(_NOT_NUMBERS, reader.line_num)
                    continue
                if not all(map(math.isfinite, values[: picker.positions])):
                    rows.reject(_NOT_FINITE, reader.line_num)
                    continue
                if stamp_ns <= latest.get(number, -_MAX_NS):
                    rows.reject(_NOT_LATER, reader.line_num)
                    continue
                latest[number] = stamp_ns
                rows.by_sweep.setdefault(number, []).append((stamp_ns, values))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or "not text"
        raise ScanError(f"{path}: expected a CSV file, {reason}") from None
    if not rows.by_sweep:
        raise ScanError(f"{path}: expected rows of numbers, found none in {rows.total} rows")
    return rows


@dataclass(frozen=True)
class _Picker:
    """Takes the wanted values out of a row."""

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
        def find(name: str) -> int:
            if name not in header:
                raise ScanError(
                    f"{path}: expected a column {name!r}, found {', '.join(header) or 'no header'}"
                )
            return header.index(name)

        stamp = naming.of("stamp_s")
        axes = [naming.of(axis) for axis in scene.axis_names if axis not in speed]
        wanted = axes + [naming.of_phalanx(phalanx) for phalanx in scene.phalanx_names]
        sweep = naming.of("sweep").names[0]
        has_sweep = sweep in header or "sweep" in naming.columns
        return cls(
            stamp_index=find(stamp.names[0]),
            nanoseconds=stamp.scale * 10**9,
            sweep_index=find(sweep) if has_sweep else None,
            indices=tuple(find(name) for columns in wanted for name in columns.names),
            scales=tuple(float(columns.scale) for columns in wanted for _ in columns.names),
            positions=len(axes),
        )

    def pick(self, row: list[str]) -> tuple[int, int, list[float]]:
        """Sweep number, stamp in ns, values; raises what ``float`` and ``Decimal`` raise."""
        # A binary float would lose up to 0.2 us of a stamp that counts from 1970.
        stamp_ns = int((Decimal(row[self.stamp_index]) * self.nanoseconds).to_integral_value())
        if abs(stamp_ns) > _MAX_NS:
            raise InvalidOperation
        number = 1 if self.sweep_index is None else int(float(row[self.sweep_index]))
        values = [float(row[index]) * scale for index, scale in zip(self.indices, self.scales, strict=True)]
        return number, stamp_ns, values


def _sweep(
    number: int, samples: list[tuple[int, list[float]]], scene: Scene, speed: Mapping[str, float]
) -> RecordedSweep:
    stamp_ns = np.array([stamp for stamp, _ in samples], dtype=np.int64)
    values = np.array([row for _, row in samples])
    recorded = [axis for axis in scene.axis_names if axis not in speed]
    columns = dict(zip(recorded, values.T, strict=False))
    elapsed_s = (stamp_ns - stamp_ns[0]) * 1e-9
    position = np.column_stack(
        [columns[axis] if axis in columns else speed[axis] * elapsed_s for axis in scene.axis_names]
    )
    strain = values[:, len(recorded) :]
    strain[~np.isfinite(strain)] = math.nan
    return RecordedSweep(number, stamp_ns, near_bounds(scene.axes, position), strain, missing_status(strain))
