"""Reading CSV files as a recording: one row per sample, one sweep per file or per value of a column.

Standard columns are ``stamp_s, sweep, <axis>..., <phalanx>_1, <phalanx>_2, ...`` in SI units, and, where it
is known, ``felt``: 1 from contact with a feature to its end. A
:class:`~tactile_localizer.io.csv.columns.ColumnNaming` gives other names and units. Poses may be in a file of
their own, with stamps of their own. Invalid rows are skipped, counted and reported.
"""

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from decimal import Decimal
from functools import partial
from itertools import cycle
from pathlib import Path

import numpy as np

from tactile_localizer.errors import ScanError, listed
from tactile_localizer.io.csv.columns import FELT, SWEEP, TRUE, ColumnNaming
from tactile_localizer.io.csv.table import Table, in_other_unit, read_table
from tactile_localizer.io.names import Names
from tactile_localizer.io.recording import (
    RecordedSweep,
    Recording,
    cut_rows,
    join,
    pose_notes,
    row_notes,
    undelayed,
)
from tactile_localizer.io.status import missing_status
from tactile_localizer.scene import Scene
from tactile_localizer.streams.arrivals import Seen
from tactile_localizer.streams.clocks import is_of_zones
from tactile_localizer.streams.runs import LATE, NANOSECONDS, rows_at, runs_of
from tactile_localizer.streams.sweep_detector import SweepDetector
from tactile_localizer.streams.synchronization import (
    DEFAULT_MAX_GAP_S,
    interpolate_runs,
    near_bounds,
)

LOCAL_TIME = (".asc", ".mf4")
"""Formats of CAN logs with local time, which python-can reads as of the zone of this machine."""
_PERIOD_S = 5e-5, 0.5
"""Shortest and longest plausible time between samples of a tactile sensor, s (judgement)."""
_LONGEST_M = 3.0
"""Longest plausible range of positions on material, m (judgement)."""
_NEARER_TO_MM = math.sqrt(1000.0)
"""Range of positions by the scene's extent above which it is nearer to one in mm than in m, in ratio."""
_YEAR_2000_S = 946_684_800
_PAUSE = 3.0
"""Time between two rows, in the usual one, above which there were none for a while (judgement)."""
_IRREGULAR = 0.25
"""Range of the middle half of the steps, by their median, that no sampling has (judgement)."""


def read_csv(
    paths: str | Path | Sequence[str | Path],
    scene: Scene,
    naming: ColumnNaming | None = None,
    *,
    poses: Sequence[str | Path] = (),
    max_gap_s: float = DEFAULT_MAX_GAP_S,
    delay_s: float = 0.0,
    strain: Callable[[Path], Table] | None = None,
    detector: SweepDetector | None = None,
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
    delay_s : time by which the strain is late against the poses, s
    strain : reads the strain of ``paths`` if these are no CSV files; then there are ``poses``
    detector : detects sweeps in the motion, within each of the recorded ones

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
    read = partial(_read_file, scene, naming, max_gap_s, delay_s, strain, detector)
    recording = join([read(path, pose) for path, pose in zip(files, beside)])  # noqa: B905
    return recording if poses else undelayed(recording, scene.axes, delay_s, max_gap_s)


def _read_file(
    scene: Scene,
    naming: ColumnNaming,
    max_gap_s: float,
    delay_s: float,
    strain: Callable[[Path], Table] | None,
    detector: SweepDetector | None,
    path: Path,
    pose_path: Path | None,
) -> Recording:
    axes = {name: naming.of(name) for name in scene.axis_names}
    strains = {each.name: naming.of(each.name, each.channels) for each in scene.phalanges}
    if strain is None:
        table = read_table(path, scene, naming, "stamp_s", {} if pose_path else axes, strains, pose_path)
    else:
        table = strain(path)
    label, notes, stamp_ns = _sweep_numbers(path, table), table.notes, table.stamp_ns
    if pose_path is None:
        notes += _unit_notes(path, scene, naming, axes, table)
        position, run, truth = _of_rows(scene, naming, axes, table, label)
    else:
        stamp = "pose_stamp_s" if "pose_stamp_s" in naming.columns else "stamp_s"
        poses = read_table(pose_path, scene, naming, stamp, axes, {}, None if strain else path)
        notes += [*poses.notes, *_unit_notes(pose_path, scene, naming, axes, poses)]
        run, pose_run = runs_of(stamp_ns), runs_of(poses.stamp_ns)
        stamp_ns, label = _when_felt(stamp_ns, run, label, delay_s)
        notes += row_notes(f"rows of {pose_path}", pose_run)
        shift = partial(_shift_advice, naming.of(stamp), path if strain else None, int(stamp_ns[0]))
        in_order = pose_run != LATE
        pose_ns, places = poses.stamp_ns[in_order], poses.position[in_order]
        seen = Seen(scene.axes, stamp_ns[run != LATE], pose_ns, places, max_gap_s)
        notes += pose_notes(str(pose_path), seen, shift)

        def at_strain(positions: np.ndarray) -> np.ndarray:
            def poses_of(number: int, stamp_ns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
                # Files do not say during which run of the poses strain arrived: in its own, or the only one.
                rows = pose_run == (number if pose_run.max() else 0)
                return poses.stamp_ns[rows], positions[rows]

            return interpolate_runs(scene.axes, run, stamp_ns, poses_of, max_gap_s)

        position = at_strain(poses.position)
        truth = None if (known := _truth(scene, poses)) is None else at_strain(known)
    status, unit = missing_status(table.strain, scene.layout), naming.strain_unit
    felt = table.beside[FELT] > 0.0 if FELT in table.beside else None
    samples = RecordedSweep(0, stamp_ns, position, table.strain, status, truth, 0, felt, strain_unit=unit)
    sweeps, of_rows = cut_rows(f"rows of {path}", samples, run, label, detector)
    notes += of_rows
    beside_ns = poses.stamp_ns if pose_path else np.empty(0)
    if finding := _implausible_stamps(table.stamp_ns, beside_ns, naming.of("stamp_s")):
        notes.append(f"{path}: {finding}")
    return Recording(str(path), tuple(sweeps), tuple(notes), table.lost + int(np.sum(run == LATE)))


def _when_felt(
    stamp_ns: np.ndarray, run: np.ndarray, label: np.ndarray, delay_s: float
) -> tuple[np.ndarray, np.ndarray]:
    """Stamps (n,), ns, at which late strain was felt, and numbers (n,) of the sweeps in progress then.

    Rows felt in a pause before theirs, where there are none, are of the sweep that follows it.
    """
    felt_ns, in_progress = stamp_ns - round(delay_s * NANOSECONDS), label.copy()
    for each in {*run.tolist()} - {LATE} if delay_s else ():
        rows = np.flatnonzero(run == each)
        step_ns = np.diff(stamp_ns[rows], prepend=stamp_ns[rows[0]])
        pause = np.cumsum(step_ns > _PAUSE * np.median(step_ns))
        newest = rows_at(stamp_ns[rows], felt_ns[rows])
        is_since = pause[newest] == pause
        in_progress[rows[is_since]] = label[rows[newest[is_since]]]
    return felt_ns, in_progress


def _of_rows(
    scene: Scene, naming: ColumnNaming, axes: Mapping[str, Names], table: Table, label: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Positions (n, d) of rows that have them, their runs, and the truth (n, d)."""
    begun = np.flatnonzero(np.diff(label, prepend=-1))
    timed = [each.names == naming.of("stamp_s").names for each in axes.values()]  # a constant speed
    position = table.position
    position[:, timed] -= np.repeat(position[begun][:, timed], np.diff([*begun, len(label)]), axis=0)
    run = np.concatenate([runs_of(part) for part in np.split(table.stamp_ns, begun[1:])])
    return near_bounds(scene.axes, position), run, _truth(scene, table)


def _shift_advice(stamp: Names, log: Path | None, stamp_ns: int, ahead_s: float) -> str:
    """How to shift poses whose clock is ahead by a time, s, and the time zone of a log with local time."""
    terms = "+".join(
        name if factor == 1 else f"{name}*{factor}"
        for name, factor in zip(stamp.names, stamp.factors, strict=True)
    )
    offset = stamp.offset - Decimal(f"{ahead_s:.15g}")
    advice = f"; --column pose_stamp_s={terms}{offset.normalize():+f} shifts the poses" if offset else ""
    if log is None or log.suffix.lower() not in LOCAL_TIME or not is_of_zones(ahead_s):
        return advice
    # The log was read as of the zone of this machine. POSIX counts zones towards the west.
    west = round(ahead_s) - time.localtime(stamp_ns // NANOSECONDS).tm_gmtoff
    hours, minutes = divmod(abs(west) // 60, 60)
    zone = f"UTC{'-' if west < 0 else '+'}{hours}" + f":{minutes:02}" * bool(minutes)
    return f"; {log.suffix} has the local time of where it was written: TZ={zone} reads it as such{advice}"


def _implausible_stamps(stamp_ns: np.ndarray, beside_ns: np.ndarray, columns: Names) -> str:
    """What is implausible about the stamps of rows, in one line: too coarse, or in another unit.

    Points that are measured at rest may be seconds apart. Then their stamps are those of a clock since 1970,
    irregular, or in the middle of the stamps of poses, ``beside_ns``.
    """
    step_s = 1e-9 * np.abs(np.diff(stamp_ns))
    steps_s = step_s[step_s > 0.0]
    if not len(steps_s):
        return ""
    period_s, (low_s, high_s) = np.median(steps_s), np.quantile(steps_s, [0.25, 0.75])
    if 2 * len(steps_s) < len(step_s):
        each_s = period_s * len(steps_s) / len(step_s)
        found = f"{len(step_s) - len(steps_s)} of {len(stamp_ns)} rows have the stamp of the row before"
        advice = f"--column 'stamp_s=row * {each_s:.3g}' numbers them"
        return f"{found}: a clock of {period_s:.3g} s, and rows {each_s:.3g} s apart; {advice}"
    is_since_1970 = 1e-9 * np.median(stamp_ns) > _YEAR_2000_S
    is_irregular = high_s - low_s > _IRREGULAR * period_s
    around = np.searchsorted(np.sort(beside_ns), np.quantile(stamp_ns, [0.25, 0.75])).tolist()
    is_between = around[0] > 0 and around[1] < len(beside_ns)
    at_rest = is_since_1970 or is_irregular or is_between
    if _PERIOD_S[0] <= period_s and (period_s <= _PERIOD_S[1] or at_rest):
        return ""
    return f"the stamps are {period_s:.3g} s apart{in_other_unit('stamp_s', columns)}"


def _truth(scene: Scene, table: Table) -> np.ndarray | None:
    """True positions (n, d), if the file has those on each axis."""
    known = [table.beside[TRUE[axis]] for axis in scene.axis_names if TRUE[axis] in table.beside]
    return np.column_stack(known) if len(known) == scene.dimension else None


def _unit_notes(
    path: Path, scene: Scene, naming: ColumnNaming, axes: Mapping[str, Names], table: Table
) -> Iterator[str]:
    """Findings about positions that seem to be in degrees, before they are wrapped, or in millimetres."""
    extent = dict(zip(scene.axis_names, scene.extent.tolist(), strict=True))
    read = {**dict(zip(axes, table.position.T, strict=False)), **table.beside}
    for name in (name for axis in axes for name in (axis, TRUE[axis]) if name in read):
        is_timed = naming.of(name).names == naming.of("stamp_s").names  # a constant speed, in each sweep
        if is_timed or not np.isfinite(read[name]).any():
            continue
        low, high = np.nanmin(read[name]), np.nanmax(read[name])
        column, axis = f"--column {name}={naming.of(name).names[0]}", name.removeprefix("true_")
        if axis == "yaw":
            if max(-low, high, high - low) > 2 * math.pi:
                factor = f"{column}*{math.radians(1):.6g}"
                yield f"{path}: {name} is {low:.4g} to {high:.4g} rad: in degrees? {factor}"
            continue
        most = np.subtract(*np.nanquantile(read[name], [0.95, 0.05]))  # without what is not read as it is
        if most > min(_LONGEST_M, _NEARER_TO_MM * extent[axis]):
            spans = f"{name} spans {high - low:.4g} m"
            of_scene = f", the scene {extent[axis]:.4g} m" if extent[axis] < _LONGEST_M else ""
            yield f"{path}: {spans}{of_scene} (in mm? {column}*0.001)"


def _sweep_numbers(path: Path, table: Table) -> np.ndarray:
    """Numbers (n,) of the sweeps, 1 without any; one may come again where its stamps go back."""
    sweep = table.beside.get(SWEEP, np.ones(len(table.stamp_ns)))
    if other := sweep[~((sweep % 1 == 0) & (sweep >= 0) & (sweep < 1e9))].tolist():
        raise ScanError(f"{path}: expected whole numbers in the column of the sweeps, found {other[0]:g}")
    rows = np.flatnonzero(np.diff(sweep, prepend=-1))
    begun, last_ns = sweep[rows].astype(int).tolist(), dict[int, int]()
    begin_ns, end_ns = (table.stamp_ns[each].tolist() for each in (rows, [*rows[1:] - 1, -1]))
    for number, first, last in zip(begun, begin_ns, end_ns, strict=True):
        if first >= last_ns.get(number, first + 1):
            found = listed(map(str, begun))
            raise ScanError(f"{path}: expected the rows of each sweep together, found sweeps {found}")
        last_ns[number] = last
    return sweep.astype(int)
