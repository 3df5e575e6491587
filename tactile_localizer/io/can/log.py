"""Recorded CAN logs of any format that python-can reads: strain with the stamps of the log."""

from collections.abc import Callable, Iterator
from pathlib import Path

import can
import numpy as np

from tactile_localizer.errors import ScanError, in_one_line, listed
from tactile_localizer.io.can.assembler import BusCounts, Cycle, CycleAssembler
from tactile_localizer.io.can.protocol import LoadCellProtocol
from tactile_localizer.io.status import FAULT, SATURATED

_PROGRESS_FRAMES = 1000
"""Number of frames between two reports of the progress."""


def read_log(
    path: str | Path,
    protocol: LoadCellProtocol,
    channel: str = "",
    progress: Callable[[str, float], None] = lambda text, fraction: None,
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Read the strain in a log: candump -l, .asc, .blf, .trc and what else python-can reads.

    Parameters
    ----------
    path : the log; its suffix is that of the format
    protocol : layout of the frames
    channel : channel to read; empty: the only one
    progress : called with the path and the fraction of the log that was read

    Returns
    -------
    stamp_ns : (n,) stamps, ns
    strain : (n, C) V; NaN where missing, saturated or faulty
    notes : losses, and where the log is damaged

    Raises
    ------
    ScanError
        The log cannot be read, has several channels, or no sample of the load cells.
    """
    assembler, notes, cycles = CycleAssembler(protocol), [], []
    try:
        for frame in _frames(Path(path), channel, progress):
            cycles += assembler.feed([frame])
    except ScanError:
        raise
    except Exception as error:  # readers raise many types of exceptions
        found = repr(in_one_line(error))
        notes.append(f"{path}: expected a log that python-can reads (of candump: by -l), {found:.100}")
    assembler.reset()
    cycles += assembler.feed([])
    if not cycles:
        raise ScanError("; ".join(notes) or f"{path}: {_nothing(protocol, assembler.counts)}")
    for name, counts in zip(protocol.phalanges, assembler.counts.phalanges, strict=True):
        if counts.drops:
            notes.append(f"{path}: {counts.drops} frames of {name} lost")
    strain = np.array([_usable(protocol, cycle) for cycle in cycles])
    return np.array([cycle.stamp_ns for cycle in cycles]), strain, notes


def _frames(path: Path, channel: str, progress: Callable[[str, float], None]) -> Iterator[can.Message]:
    size, channels = max(1, path.stat().st_size), set()
    with can.LogReader(path, relative_timestamp=False) as reader:
        for number, frame in enumerate(reader):
            if frame.channel is not None:
                channels.add(str(frame.channel))
            if not channel and len(channels) > 1:
                raise ScanError(f"{path}: expected one channel, found {', '.join(sorted(channels))}")
            if getattr(reader, "timestamps_format", None) == "relative":
                raise ScanError(f"{path}: expected absolute time stamps, found relative ones")
            if channel in ("", str(frame.channel)):
                yield frame
            file = getattr(reader, "file", None)
            if not number % _PROGRESS_FRAMES and file is not None and not file.closed:
                progress(str(path), min(1.0, getattr(file, "buffer", file).tell() / size))
    if channel and channel not in channels:
        raise ScanError(f"{path}: expected the channel {channel}, found {listed(sorted(channels))}")


def _usable(protocol: LoadCellProtocol, cycle: Cycle) -> np.ndarray:
    bad = (cycle.status & (SATURATED | FAULT)).astype(bool)
    return np.where(bad[protocol.channels.phalanx], np.nan, cycle.strain)


def _nothing(protocol: LoadCellProtocol, counts: BusCounts) -> str:
    """Why a log has no samples."""
    reasons = [protocol.misfit(frame, slot) for slot, frame in counts.misfits.items() if slot >= 0]
    return "; ".join(reasons) or f"none of {sum(counts.frames)} frames has an identifier of the DBC"
