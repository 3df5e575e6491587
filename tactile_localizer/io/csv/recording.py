"""Reading CSV files as a recording: one row per sample, one sweep per file or per value of a column.

Standard columns are ``stamp_s, sweep, <axis>..., <phalanx>_1, <phalanx>_2, ...`` in SI units, and, where it
is known, ``felt``: 1 from contact with a feature to its end. A
:class:`~tactile_localizer.io.csv.columns.ColumnNaming` gives other names and units. Poses may be in a file of
their own, with stamps of their own. Invalid rows are skipped, counted and reported.
"""

from __future__ import annotations

import csv
import gzip
import io
import math
import zlib
from array import array
from collections.abc import Iterator, Mapping, Sequence
from decimal import Decimal
from itertools import cycle
from pathlib import Path

import numpy as np

from tactile_localizer.core.geometry.synchronization import DEFAULT_MAX_GAP_S, interpolate_poses, near_bounds
from tactile_localizer.errors import ScanError, listed
from tactile_localizer.io.csv.columns import ColumnNaming, Columns, missing_column, phalanges_in
from tactile_localizer.io.recording import RecordedSweep, Recording, in_order, join, missing_status
from tactile_localizer.io.whole_file import open_file
from tactile_localizer.scene import Scene

_FELT = "felt"
_MAX_STAMP_NS = 2**62
"""Largest stamp: differences of stamps fit into 64 bits."""
_PERIOD_S = 5e-5, 0.5
"""Shortest and longest plausible time between samples of a tactile sensor, s (judgement)."""
_MAX_LINE, _MAX_LINES = 2**24, 20_000_000
"""Longest line, characters, and most lines, 5 h at 1 kHz: a small compressed file could fill the memory."""


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
    naming : columns with other than the standard names
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
    files = [Path(path) for path in ([paths] if isinstance(paths, str | Path) else paths)]
    if len(poses) not in (0, 1, len(files)):
        raise ScanError(f"poses: expected 1 or {len(files)} files beside {len(files)}, got {len(poses)}")
    beside = cycle([Path(path) for path in poses] or [None])
    return join([_read_file(path, scene, naming, pose, max_gap_s) for path, pose in zip(files, beside)])  # noqa: B905


def _read_file(
    path: Path, scene: Scene, naming: ColumnNaming, pose_path: Path | None, max_gap_s: float
) -> Recording:
    notes: list[str] = []
    column, axes = naming.of("stamp_s"), {name: naming.of(name) for name in scene.axis_names}
    strains = {each.name: naming.of(each.name, each.channels) for each in scene.phalanges}
    wanted = strains if pose_path else {**axes, **strains}
    table, lost = _read_table(path, scene, naming, "stamp_s", wanted, notes)
    stamp_ns, label = table["stamp_s"], table["sweep"]
    found = np.ones(len(stamp_ns), dtype=bool)
    begun = np.flatnonzero(np.diff(label, prepend=-1))
    if pose_path is not None:
        stamp = "pose_stamp_s" if "pose_stamp_s" in naming.columns else "stamp_s"
        poses, _ = _read_table(pose_path, scene, naming, stamp, axes, notes)
        pose_ns, places = poses[stamp], np.hstack([poses[name] for name in axes])
        rows = in_order(pose_ns, f"rows of {pose_path}", notes)
        position, found = interpolate_poses(scene.axes, pose_ns[rows], places[rows], stamp_ns, max_gap_s)
    else:
        position = np.hstack([table[name] for name in axes])
        timed = [each.names == column.names for each in axes.values()]  # a constant speed
        position[:, timed] -= np.repeat(position[begun][:, timed], np.diff([*begun, len(label)]), axis=0)
        position = near_bounds(scene.axes, position)
    strain = np.hstack([table[name] for name in strains])
    strain[~np.isfinite(strain)] = math.nan
    status = missing_status(strain, scene.layout)
    felt = table[_FELT][:, 0] > 0.0 if _FELT in table else None
    unit = naming.strain_unit
    samples = RecordedSweep(0, stamp_ns, position, strain, status, felt=felt, strain_unit=unit)
    sweeps, kept = [], 0
    for number in label[begun].tolist():
        rows = np.flatnonzero(label == number)
        rows = rows[in_order(stamp_ns[rows], f"rows of {path}", notes)]
        kept += len(rows)
        sweeps.append(samples.part(rows[found[rows]], number, gaps=int(np.sum(~found[rows]))))
    period_s = 1e-9 * float(np.median(np.abs(np.diff(stamp_ns)))) if len(stamp_ns) > 1 else _PERIOD_S[0]
    if not _PERIOD_S[0] <= period_s <= _PERIOD_S[1]:
        notes.append(f"{path}: the stamps are {period_s:.3g} s apart{_in_other_unit('stamp_s', column)}")
    return Recording(str(path), tuple(sweeps), tuple(notes), lost + len(stamp_ns) - kept)


def _read_table(
    path: Path,
    scene: Scene,
    naming: ColumnNaming,
    stamp: str,
    wanted: Mapping[str, Columns],
    notes: list[str],
) -> tuple[dict[str, np.ndarray], int]:
    """The valid rows by quantity, and the number of others, which are noted.

    ``stamp`` and ``sweep`` are (n,) int, ns, others (n, columns) in SI units; positions are finite.
    """
    rows = read_rows(path)
    _, header = next(rows, (0, []))
    if _FELT in header:
        wanted = {**wanted, _FELT: Columns((_FELT,))}
    needed = {stamp: naming.of(stamp), **wanted}
    if naming.of("sweep").names[0] in header or "sweep" in naming.columns:
        needed["sweep"] = naming.of("sweep")
    indices = _indices(path, header, needed, naming, scene)
    positions = sum(name in scene.axis_names for name in wanted)
    scale = needed[stamp].scale * 10**9
    stamps, values = array("q"), array("d")
    lost, first = 0, ""
    for line, cells in rows:
        try:
            time, numbers = _numbers([cells[each] for each in indices], positions)
        except (ValueError, ArithmeticError, IndexError):
            lost, first = lost + 1, first or f"line {line}: {listed(cells)}"
            continue
        if abs(time * scale) > _MAX_STAMP_NS:
            unit = _in_other_unit(stamp, needed[stamp])
            raise ScanError(f"{path}: expected stamps in s, found {float(time):.6g}{unit}")
        stamps.append(int((time * scale).to_integral_value()))
        values.extend(numbers)
    total = len(stamps) + lost
    if not stamps:
        raise ScanError(f"{path}: expected rows of numbers, found none in {total} rows ({first})")
    if lost:
        notes.append(f"skipped {lost} of {total} rows of {path} that are not numbers (first: {first})")
    ends = np.cumsum([len(each.names) for each in needed.values()])
    parts = np.split(np.frombuffer(values).reshape(len(stamps), -1), ends[:-1] - 1, axis=1)[1:]
    table = dict(zip(list(needed)[1:], parts, strict=True))
    sweep = table.pop("sweep", np.ones((len(stamps), 1)))[:, 0]
    for name, each in wanted.items():
        table[name] = float(each.scale) * table[name]
    return {stamp: np.array(stamps), "sweep": _sweep_numbers(path, sweep), **table}, lost


def _numbers(texts: Sequence[str], positions: int) -> tuple[Decimal, list[float]]:
    """Stamp and values of a row, of which the first are finite positions.

    Raises the exceptions of ``float`` and ``Decimal``, whose numbers may have underscores and other digits.
    """
    if not (joined := "".join(texts)).isascii() or "_" in joined:
        raise ValueError
    time, numbers = Decimal(texts[0]), list(map(float, texts[1:]))  # a float would lose 0.2 us since 1970
    if not time.is_finite() or not all(map(math.isfinite, numbers[:positions])):
        raise ValueError
    return time, numbers


def _indices(
    path: Path, header: Sequence[str], needed: Mapping[str, Columns], naming: ColumnNaming, scene: Scene
) -> list[int]:
    """Places of the columns in the header, each of which there is once, and of each phalanx all."""
    channels = {phalanx.name: phalanx.channels for phalanx in scene.phalanges}
    for name, found in phalanges_in(header, naming).items():
        if name in needed and found != channels[name]:
            raise ScanError(
                f"{path}: expected {channels[name]} channels for phalanx {name} as in the scene, found "
                f"{found} columns; write channels: {found} below {name} in the scene"
            )
    for quantity, columns in needed.items():
        for name in columns.names:
            if name not in header:
                raise missing_column(path, header, quantity, naming, scene)
            if header.count(name) > 1:
                raise ScanError(f"{path}: expected one column {name!r}, found {header.count(name)}")
    return [header.index(name) for columns in needed.values() for name in columns.names]


def _sweep_numbers(path: Path, sweep: np.ndarray) -> np.ndarray:
    """The column of the sweeps (n,) as integers, equal ones of which are together."""
    if other := sweep[~((sweep % 1 == 0) & (sweep >= 0) & (sweep < 1e9))].tolist():
        raise ScanError(f"{path}: expected whole numbers in the column of the sweeps, found {other[0]:g}")
    begun = sweep[np.flatnonzero(np.diff(sweep, prepend=-1))].astype(int).tolist()
    if len(set(begun)) < len(begun):
        raise ScanError(
            f"{path}: expected the rows of each sweep together, found sweeps {listed(map(str, begun))}"
        )
    return sweep.astype(int)


def read_rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Line number and cells of each row, header first; the file may be compressed with gzip.

    The delimiter is the most frequent one in the header: comma, semicolon or tab. Blank lines and lines that
    begin with # are skipped.

    Raises
    ------
    ScanError
        The file cannot be read, is not UTF-8 text, is too large, or has a row with more cells than the
        header.
    """
    width, delimiter = 0, ","
    try:
        with open_file(path) as stored:
            is_gzip = stored.read(2) == b"\x1f\x8b"
            stored.seek(0)
            content = gzip.GzipFile(fileobj=stored) if is_gzip else stored
            text = io.TextIOWrapper(content, "utf-8-sig", newline="")
            for number, line in enumerate(iter(lambda: text.readline(_MAX_LINE), ""), 1):
                if number > _MAX_LINES or len(line) == _MAX_LINE:
                    raise ScanError(
                        f"{path} line {number}: expected at most {_MAX_LINES} lines of {_MAX_LINE} characters"
                    )
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
    except (OSError, EOFError, zlib.error, ValueError, csv.Error) as error:
        raise ScanError(f"{path}: expected a CSV file, {getattr(error, 'strerror', '') or error}") from None


def _in_other_unit(quantity: str, column: Columns) -> str:
    name = f"--column {quantity}={column.names[0]}"
    return f" (another unit? {name}*0.001 for ms, *1e-6 for us, *1e-9 for ns)"
