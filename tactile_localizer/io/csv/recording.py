"""Reading CSV files as a recording: one row per sample, one sweep per file or per value of a column.

Standard columns are ``stamp_s, sweep, <axis>..., <phalanx>_1, <phalanx>_2, ...`` in SI units, and, where it
is known, ``felt``: 1 from contact with a feature to its end. A
:class:`~tactile_localizer.io.csv.columns.ColumnNaming` gives other names and units, and a constant speed
for positions that were not recorded. Poses may be in a file of their own, with stamps of their own. Invalid
rows are skipped, counted and reported.
"""

from __future__ import annotations

import csv
import gzip
import math
import zlib
from collections.abc import Iterator, Mapping, Sequence
from decimal import Decimal
from itertools import cycle
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tactile_localizer.core.geometry.synchronization import DEFAULT_MAX_GAP_S, interpolate_poses, near_bounds
from tactile_localizer.errors import ScanError
from tactile_localizer.io.csv.columns import (
    ColumnNaming,
    Columns,
    listed,
    missing_column,
    standard_channels,
)
from tactile_localizer.io.recording import RecordedSweep, Recording, in_order, join, missing_status
from tactile_localizer.scene import Axis, Phalanx, Scene

_FELT = "felt"
_MAX_STAMP_NS = 2**62
"""Largest stamp: differences of stamps fit into 64 bits."""

_SLOWEST_PERIOD_S = 0.5
"""Longest plausible time between samples of a tactile sensor, s (judgement)."""


def read_csv(
    paths: str | Path | Sequence[str | Path],
    scene: Scene,
    naming: ColumnNaming | None = None,
    *,
    poses: Sequence[str | Path] = (),
    max_gap_s: float = DEFAULT_MAX_GAP_S,
) -> Recording:
    """Read one or several CSV files as one recording.

    Parameters
    ----------
    paths : the files; each is one sweep unless it has a column ``sweep``
    scene : axes and phalanges to read
    naming : columns with other than the standard names, and constant speeds
    poses : files with the palm positions, one for all or one for each of ``paths``; their positions are
        interpolated at the stamps of the strain as the nodes do
    max_gap_s : longest time between two poses across which is interpolated, s

    Returns
    -------
    Recording
        Recorded positions; strain that is not finite is NaN with status MISSING. The notes count the
        skipped rows.

    Raises
    ------
    MissingColumnError
        A file lacks a column.
    ScanError
        A file cannot be read, has no valid row, or stamps that do not increase.
    """
    naming = naming or ColumnNaming()
    naming.check(scene)
    for axis in scene.axes:
        if axis.name in naming.speed and not axis.lower <= 0.0 <= axis.upper:
            raise ScanError(
                f"speed of axis {axis.name}: the positions begin at 0, expected bounds that contain 0, "
                f"got {axis.lower:g} to {axis.upper:g}"
            )
    files = [Path(path) for path in ([paths] if isinstance(paths, str | Path) else paths)]
    if len(poses) not in (0, 1, len(files)):
        raise ScanError(f"poses: expected 1 or {len(files)} files beside {len(files)}, got {len(poses)}")
    beside = cycle([Path(path) for path in poses] or [None])
    return join([_read_file(path, scene, naming, pose, max_gap_s) for path, pose in zip(files, beside)])  # noqa: B905


def _read_file(
    path: Path, scene: Scene, naming: ColumnNaming, pose_path: Path | None, max_gap_s: float
) -> Recording:
    axes = {axis: naming.of(axis) for axis in scene.axis_names if axis not in naming.speed}
    phalanges = {phalanx.name: naming.of_phalanx(phalanx) for phalanx in scene.phalanges}
    table = _read_table(path, scene, naming, "stamp_s", phalanges if pose_path else {**axes, **phalanges})
    notes = table.notes
    found = np.ones(len(table.stamp_ns), dtype=bool)
    if pose_path:
        named = "pose_stamp_s" if "pose_stamp_s" in naming.columns else "stamp_s"
        poses = _read_table(pose_path, scene, naming, named, axes)
        notes += poses.notes
        poses = poses.part(in_order(poses.stamp_ns, f"rows of {pose_path}", notes))
        kinds = tuple(axis for axis in scene.axes if axis.name in axes)
        place = np.hstack([poses.columns[name] for name in axes])
        place, found = interpolate_poses(kinds, poses.stamp_ns, place, table.stamp_ns, max_gap_s)
        table.columns.update(zip(axes, place.T[:, :, None], strict=True))
    sweeps, kept = [], 0
    for number in dict.fromkeys(table.sweep.tolist()):
        rows = np.flatnonzero(table.sweep == number)
        rows = rows[in_order(table.stamp_ns[rows], f"rows of {path}", notes)]
        kept += len(rows)
        own = table.part(rows)
        for axis in scene.axes:
            if axis.name in naming.speed:
                own.columns[axis.name] = _travelled(own.stamp_ns, naming.speed[axis.name], axis)[:, None]
        position = near_bounds(scene.axes, np.hstack([own.columns[name] for name in scene.axis_names]))
        strain = np.hstack([own.columns[name] for name in scene.phalanx_names])
        strain[~np.isfinite(strain)] = math.nan
        status = missing_status(strain, scene.layout)
        felt = own.columns[_FELT][:, 0] > 0.0 if _FELT in own.columns else None
        sweep = RecordedSweep(int(number), own.stamp_ns, position, strain, status, felt=felt)
        sweeps.append(sweep.part(found[rows], sweep.number, gaps=int(np.sum(~found[rows]))))
    column = naming.of("stamp_s")
    if 2 * kept < len(table.stamp_ns):
        raise ScanError(
            f"{path}: expected increasing stamps in column {column.names[0]!r}, found {kept} of "
            f"{len(table.stamp_ns)} (another column, a unit that is too large, or several sweeps without a "
            "column sweep?)"
        )
    notes += _unit_notes(path, table.stamp_ns, column)
    lost = table.lost + len(table.stamp_ns) - kept
    return Recording(str(path), tuple(sweeps), tuple(notes), lost)


class _Table(NamedTuple):
    """Valid rows of a file.

    ``stamp_ns`` (n,), ``sweep`` (n,), and ``columns`` by quantity, (n, 1) or (n, channels) in SI units.
    """

    stamp_ns: np.ndarray
    sweep: np.ndarray
    columns: dict[str, np.ndarray]
    notes: list[str]
    lost: int

    def part(self, rows: np.ndarray) -> _Table:
        """The rows with these indices."""
        columns = {name: values[rows] for name, values in self.columns.items()}
        return self._replace(stamp_ns=self.stamp_ns[rows], sweep=self.sweep[rows], columns=columns)


def _read_table(
    path: Path, scene: Scene, naming: ColumnNaming, stamp: str, wanted: Mapping[str, Columns]
) -> _Table:
    """Rows with the columns of ``wanted``, of which the axes come first and must be finite."""
    rows = read_rows(path)
    _, header = next(rows, (0, []))
    for phalanx in scene.phalanges:
        if phalanx.name in wanted and phalanx.name not in naming.columns:
            _require_all_channels(path, header, phalanx)

    def index(quantity: str, name: str) -> int:
        if name not in header:
            raise missing_column(path, header, quantity, naming, scene)
        if header.count(name) > 1:
            raise ScanError(f"{path}: expected one column {name!r}, found {header.count(name)}")
        return header.index(name)

    number = naming.of("sweep").names[0]
    has_sweep = "sweep" in naming.columns or number in header
    wanted = {**wanted, _FELT: Columns((_FELT,))} if _FELT in header else wanted
    positions = sum(name in scene.axis_names for name in wanted)
    time = naming.of(stamp)
    columns = [index(stamp, time.names[0]), index("sweep", number) if has_sweep else -1]
    columns += [index(what, name) for what, each in wanted.items() for name in each.names]
    samples: list[tuple[int, int, list[float]]] = []
    lost, first = 0, ""
    for line, cells in rows:
        try:
            samples.append(_numbers(cells, columns, time, positions))
        except (ValueError, ArithmeticError, IndexError):
            lost, first = lost + 1, first or f"line {line}: {listed(cells)}"
    total = len(samples) + lost
    if not samples:
        raise ScanError(f"{path}: expected rows of numbers, found none in {total} rows ({first})")
    stamps, sweeps, values = zip(*samples, strict=True)
    latest = max(map(abs, stamps))
    if latest > _MAX_STAMP_NS:
        raise ScanError(
            f"{path}: expected stamps in s in column {time.names[0]!r}, found "
            f"{float(latest / (time.scale * 10**9)):.6g}{_in_other_unit(stamp, time)}"
        )
    note = f"skipped {lost} of {total} rows of {path} that are not numbers (first: {first})"
    ends = np.cumsum([len(each.names) for each in wanted.values()])
    parts = np.split(np.array(values), ends[:-1], axis=1)
    scaled = {
        name: float(each.scale) * part for (name, each), part in zip(wanted.items(), parts, strict=True)
    }
    return _Table(np.array(stamps), np.array(sweeps), scaled, [note] if lost else [], lost)


def _numbers(
    cells: list[str], columns: Sequence[int], time: Columns, positions: int
) -> tuple[int, int, list[float]]:
    """Stamp (ns), sweep and values of a row; raises the exceptions of ``float`` and ``Decimal``."""
    # A binary float would lose up to 0.2 µs of a stamp since 1970.
    stamp_ns = int((Decimal(cells[columns[0]]) * time.scale * 10**9).to_integral_value())
    sweep = 1 if columns[1] < 0 else int(float(cells[columns[1]]))
    values = [float(cells[each]) for each in columns[2:]]
    if abs(sweep) > _MAX_STAMP_NS or not all(map(math.isfinite, values[:positions])):
        raise ValueError
    return stamp_ns, sweep, values


def _require_all_channels(path: Path, header: Sequence[str], phalanx: Phalanx) -> None:
    """Require that the scene uses all columns of a phalanx."""
    found = standard_channels(header, phalanx.name)
    if found > phalanx.channels:
        raise ScanError(
            f"{path}: expected {phalanx.channels} channels for phalanx {phalanx.name} as in the scene, "
            f"found {found} columns {phalanx.name}_1 to {phalanx.name}_{found}; write "
            f"channels: {found} below {phalanx.name} in the scene"
        )


def read_rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Line number and cells of each row, header first; the file may be compressed with gzip.

    The delimiter is the most frequent one in the header: comma, semicolon or tab. Blank lines and lines that
    begin with # are skipped.

    Raises
    ------
    ScanError
        The file cannot be read, is not UTF-8 text, or has a row with more cells than the header.
    """
    try:
        with path.open("rb") as stored:
            is_gzip = stored.read(2) == b"\x1f\x8b"
        opened = gzip.open if is_gzip else open
        with opened(path, "rt", encoding="utf-8-sig", newline="") as file:
            lines = enumerate(file, 1)
            width, delimiter = 0, ","
            for number, line in lines:
                if line.isspace() or line.startswith("#"):
                    continue
                if not width:
                    delimiter = max(",;\t", key=line.count)
                cells = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
                cells = [cell.strip() for cell in cells] if not width else cells
                width = width or len(cells)
                if len(cells) > width and any(map(str.strip, cells[width:])):
                    raise ScanError(
                        f"{path} line {number}: expected {width} cells as in the header, found {len(cells)} "
                        "(decimal commas? write points)"
                    )
                yield number, cells
    except UnicodeDecodeError:
        raise ScanError(f"{path}: expected a CSV file in UTF-8, found other bytes") from None
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise ScanError(f"{path}: expected a CSV file in gzip, {error}") from None
    except (OSError, ValueError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or error
        raise ScanError(f"{path}: expected a CSV file, {reason}") from None


def _unit_notes(path: Path, stamp_ns: np.ndarray, column: Columns) -> Iterator[str]:
    """A hint if the stamps are too far apart for a tactile sensor."""
    period_s = float(np.median(np.abs(np.diff(stamp_ns)))) * 1e-9 if len(stamp_ns) > 1 else 0.0
    if period_s > _SLOWEST_PERIOD_S:
        yield f"{path}: the stamps are {period_s:.3g} s apart{_in_other_unit('stamp_s', column)}"


def _in_other_unit(quantity: str, column: Columns) -> str:
    name = f"--column {quantity}={column.names[0]}"
    return f" (another unit? {name}*0.001 for ms, *1e-6 for us, *1e-9 for ns)"


def _travelled(stamp_ns: np.ndarray, speed: float, axis: Axis) -> np.ndarray:
    """Positions at constant speed, (n,) m (rad), from 0 or, with negative speed, to 0."""
    ends_at_zero = speed < 0 < axis.lower + axis.upper
    return np.asarray(speed * (stamp_ns - stamp_ns[-1 if ends_at_zero else 0]) * 1e-9)
