"""The readers of recordings: those of this package, and of others by their entry points.

The suffix decides, the longest of those that fit; a reader of another package may replace one of ours. A
folder is a scan or a bag, unless it has a suffix of another package. A file without a suffix, or with a
number in its place, is a table.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_localizer.errors import ScanError
from tactile_localizer.io.csv.recording import read_csv
from tactile_localizer.io.csv.table import Table
from tactile_localizer.io.recording import (
    BAG_EXTENSIONS,
    RecordedSweep,
    Recording,
    cut_rows,
    is_scan,
    numbered_apart,
    undelayed,
)
from tactile_localizer.io.scans.folder import ScanFolder
from tactile_localizer.io.status import missing_status
from tactile_localizer.plugins import installed, named_faults, only
from tactile_localizer.scene import Scene
from tactile_localizer.streams.runs import runs_of
from tactile_localizer.streams.sweep_detector import SweepDetector
from tactile_localizer.streams.synchronization import DEFAULT_MAX_GAP_S

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

GROUP = "tactile_localizer.readers"
"""Group of the entry points; the name of one is the suffix that it reads."""


@dataclass(frozen=True)
class Reader:
    """Reader of one kind of recordings.

    Parameters
    ----------
    kind : as ``import`` names it
    what : its recordings, in the plural
    suffixes : of its files, in lower case
    read : reads the recording at a path for a scene, with the options of the kind and, but of a scan, the
        ``delay_s`` by which its strain is late
    """

    kind: str
    what: str
    suffixes: tuple[str, ...]
    read: Callable[..., Recording]


def reader_of(path: str | Path) -> Reader:
    """The reader of a recording.

    Raises
    ------
    ScanError
        No reader has the suffix of the file.
    """
    path = Path(path)
    if is_scan(path):
        return READERS["scan"]
    is_folder = os.path.isdir(path)  # noqa: PTH112  false where the name is too long, too
    readers = [*([] if is_folder else READERS.values()), *_others()]
    by_suffix = {suffix: reader for reader in readers for suffix in reader.suffixes}
    if found := [suffix for suffix in by_suffix if path.name.lower().endswith(suffix)]:
        return by_suffix[max(found, key=len)]
    is_known = not path.suffix or path.suffix[1:2].isdigit()  # run_0.5mm has no suffix, but a number
    if not (is_known or is_folder) and os.path.lexists(path):  # who reads a missing one reports that
        raise ScanError(
            f"{path}: expected a folder, or a file of {', '.join(sorted(by_suffix))}, found {path.suffix}"
        )
    return READERS["bag" if is_folder else "csv"]


def importable() -> dict[str, Reader]:
    """The readers of all that can be made a scan, by kind."""
    own = {kind: reader for kind, reader in READERS.items() if kind != "scan"}
    return {**{reader.kind: reader for reader in _others()}, **own}


def _others() -> list[Reader]:
    """The readers of other packages, of which the suffix is the kind, without its dot unless we have that."""
    by_suffix: dict[str, list[EntryPoint]] = {}
    for name, entries in installed(GROUP).items():
        by_suffix.setdefault(f".{name.lower().lstrip('.')}", []).extend(entries)
    return [
        Reader(
            suffix if suffix[1:] in READERS else suffix[1:],
            f"{suffix} files",
            (suffix,),
            partial(_of_other, entries),
        )
        for suffix, entries in by_suffix.items()
    ]


def _bag(path: str | Path, scene: Scene, **options: Any) -> Recording:
    """A bag, of which the localization is wanted unless ``by_status``; options of :func:`.read_bag`."""
    from tactile_localizer.io.bags.recording import read_bag  # rosbags takes a while to import

    return read_bag(path, scene, **{"by_status": False, **options})


def _can(
    path: str | Path,
    scene: Scene,
    *,
    dbc: str | Path,
    poses: Sequence[str | Path],
    parameters: Mapping[str, Any] | None = None,
    channel: str = "",
    progress: Callable[[str, float], None] = lambda text, fraction: None,
    **options: Any,
) -> Recording:
    """A CAN log with CSV files of palm positions; other options as :func:`.read_csv`.

    Parameters
    ----------
    dbc : CAN database, a file or the name of a shipped one
    poses : the file of the positions
    parameters : of the driver node, for messages or signals with other than the default names
    channel : of a log of several
    progress : called with the path and the fraction of the log that was read
    """
    from tactile_localizer.io.can.log import read_log  # cantools takes a while to import
    from tactile_localizer.io.can.protocol import protocol_of

    protocol = protocol_of(scene.phalanx_names, {**(parameters or {}), "dbc": dbc})
    scene.channels(protocol.phalanges, protocol.channels.counts)  # as many as the scene has

    def table(path: Path) -> Table:
        stamp_ns, strain, lost, notes = read_log(path, protocol, channel, progress)
        return Table(stamp_ns, np.empty((len(strain), 0)), strain, {}, lost, notes)

    return read_csv(path, scene, poses=poses, strain=table, **options)


def _scan(path: str | Path, scene: Scene) -> Recording:
    return ScanFolder(path).recording(scene)


def _of_other(
    entries: list[EntryPoint],
    path: str | Path,
    scene: Scene,
    *,
    detector: SweepDetector | None = None,
    delay_s: float = 0.0,
    max_gap_s: float = DEFAULT_MAX_GAP_S,
) -> Recording:
    """What a reader of another package reads: with arrays that fit the scene, cut into sweeps as others."""
    entry, package = only(entries, ScanError)
    what = f"{path}: reader {entry.value} of {package}"
    with named_faults(what, "a recording", ScanError):
        recording = entry.load()(Path(path), scene)
        if not isinstance(recording, Recording):
            raise ScanError(f"{what}: expected a Recording, got {type(recording).__name__}")
        sweeps, notes = list[RecordedSweep](), [*recording.notes]
        for sweep in recording.sweeps:
            samples = _fitting(what, sweep, scene)
            run = runs_of(samples.stamp_ns)
            number, what_rows = np.full(len(run), sweep.number), f"samples of sweep {sweep.number}"
            found, of_rows = cut_rows(what_rows, samples, run, number, detector)
            sweeps += found
            notes += of_rows
        read = replace(recording, sweeps=tuple(numbered_apart(sweeps)), notes=tuple(notes))
        return undelayed(read, scene.axes, delay_s, max_gap_s)


def _fitting(what: str, sweep: RecordedSweep, scene: Scene) -> RecordedSweep:
    """A sweep of another package; phalanges whose strain is not finite are MISSING.

    Raises
    ------
    ScanError
        An array has another shape or kind of values than a recording for the scene.
    """
    d, channels, phalanges = scene.dimension, scene.layout.size, len(scene.phalanges)
    forms: dict[str, tuple[type, str, tuple[int, ...]]] = {
        "stamp_ns": (np.int64, "iu", ()),
        "position": (np.float64, "fiu", (d,)),
        "strain": (np.float64, "fiu", (channels,)),
        "status": (np.uint8, "iu", (phalanges,)),
        "truth": (np.float64, "fiu", (d,)),
        "felt": (np.bool_, "b", ()),
    }
    arrays: dict[str, Any] = {}
    for name, (kind, kinds, columns) in forms.items():
        if (given := getattr(sweep, name)) is None and name in ("truth", "felt"):
            continue
        array, shape = np.asarray(given), (len(sweep.stamp_ns), *columns)
        if array.shape != shape or array.dtype.kind not in kinds:
            found = f"{array.dtype} of shape {array.shape}"
            raise ScanError(f"{what}: {name}: expected {kind.__name__} of shape {shape}, got {found}")
        arrays[name] = array.astype(kind)
    arrays["status"] |= missing_status(arrays["strain"], scene.layout)
    return replace(sweep, **arrays)


def _compressed(*suffixes: str) -> Iterable[str]:
    """Suffixes, also of files that gzip has compressed."""
    return (suffix + end for suffix in suffixes for end in ("", ".gz"))


_CSV = (*_compressed(".csv", ".tsv", ".txt", ".dat"), ".gz")
_LOGS = (*_compressed(".asc", ".blf", ".log", ".trc"), ".db", ".mf4")
READERS = {
    reader.kind: reader
    for reader in (
        Reader("csv", "CSV files, each a sweep unless a column has the sweep numbers", _CSV, read_csv),
        Reader("bag", "bags: SQLite or MCAP, directory or file", (*BAG_EXTENSIONS, ".bag"), _bag),
        Reader("can", "CAN logs: candump -l, .asc, .blf or .trc, with --poses beside them", _LOGS, _can),
        Reader("scan", "scans", (), _scan),
    )
}
"""The readers of this package by kind."""
