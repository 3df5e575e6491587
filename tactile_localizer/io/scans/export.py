"""Export of a scan's pairs to CSV and to numpy's npz."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np

from tactile_localizer.errors import ScanError
from tactile_localizer.io.csv.columns import channel_names
from tactile_localizer.io.recording import Recording
from tactile_localizer.io.scans.store import ScanStore
from tactile_localizer.io.scene_file import scene_to_dict
from tactile_localizer.io.whole_file import whole_file

FORMATS = (".csv", ".npz")


def export_scan(store: ScanStore, path: str | Path) -> None:
    """Write the pairs of all sweeps that are not dropped, in the format given by the file's extension.

    The CSV file has the standard columns, so ``import csv`` reads the same scan back. The npz holds
    ``stamp_ns`` (N,), ``states`` (N, d), ``strain`` (N, C), ``sweep`` (N,), ``axes``, ``phalanges``,
    ``channels`` (F,), and ``scene`` as JSON.

    Raises
    ------
    ScanError
        The extension is neither, there are no pairs, or the file cannot be written.
    """
    path = Path(path)
    if path.suffix not in FORMATS:
        raise ScanError(
            f"{path}: expected the extension {' or '.join(FORMATS)}, found {path.suffix or 'none'}"
        )
    recording = store.recording()
    if not len(recording):
        raise ScanError(f"{store.path}: expected at least one state-measurement pair, found none")
    try:
        with whole_file(path) as unfinished:
            if path.suffix == ".csv":
                _write_csv(recording, unfinished)
            else:
                _write_npz(recording, json.dumps(scene_to_dict(store.scene)), unfinished)
    except OSError as error:
        raise ScanError(f"{path}: expected a writable file, {error.strerror}") from None


def _write_csv(recording: Recording, path: Path) -> None:
    counts = zip(recording.phalanges, recording.layout.counts, strict=True)
    strain = [column for name, channels in counts for column in channel_names(name, channels)]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["stamp_s", "sweep", *recording.axes, *strain])
        for sweep in recording.sweeps:
            # tolist() gives Python floats, whose repr is the shortest text that reads back exactly.
            rows = zip(sweep.stamp_ns.tolist(), sweep.position.tolist(), sweep.strain.tolist(), strict=True)
            writer.writerows(
                [_seconds(stamp), sweep.number, *position, *values] for stamp, position, values in rows
            )


def _seconds(stamp_ns: int) -> str:
    sign = "-" if stamp_ns < 0 else ""
    seconds, nanoseconds = divmod(abs(stamp_ns), 1_000_000_000)
    return f"{sign}{seconds}.{nanoseconds:09d}"


def _write_npz(recording: Recording, scene: str, path: Path) -> None:
    sweeps = recording.sweeps
    np.savez_compressed(
        path,
        stamp_ns=np.concatenate([sweep.stamp_ns for sweep in sweeps]),
        states=np.concatenate([sweep.position for sweep in sweeps]),
        strain=np.concatenate([sweep.strain for sweep in sweeps]),
        sweep=np.concatenate([np.full(len(sweep), sweep.number) for sweep in sweeps]),
        axes=np.array(recording.axes),
        phalanges=np.array(recording.phalanges),
        channels=np.array(recording.layout.counts),
        scene=np.array(scene),
    )
