"""Recorded CAN logs of any format that python-can reads: strain with the stamps of the log."""

import math
import re
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import can
import numpy as np
from can.io.generic import MessageReader, TextIOMessageReader

from tactile_localizer.errors import ScanError, counted, in_one_line, listed
from tactile_localizer.io.can.assembler import BusCounts, Cycle, CycleAssembler
from tactile_localizer.io.can.counter import TWO_SENDERS
from tactile_localizer.io.can.findings import are_of_two, describe_counter, describe_discarded
from tactile_localizer.io.can.protocol import FrameKind, LoadCellProtocol
from tactile_localizer.io.status import FAULT, SATURATED
from tactile_localizer.streams.alternation import alternates

_EXPECTED = "expected a log that python-can reads (of candump: by -l)"
_PROGRESS_FRAMES = 1000
"""Number of frames between two reports of the progress."""

_FROM_0 = (can.ASCReader, can.BLFReader)
"""Readers that subtract 1 from the channels' numbers in the file."""

_RAW_LENGTH = re.compile(r"(?<=#[0-9A-Fa-f]{16})_[9A-Fa-f]\b")
"""Length code above 8 behind the 8 bytes of a frame, which candump writes and python-can does not read."""


class Log(NamedTuple):
    """Strain in a log.

    Parameters
    ----------
    stamp_ns : (n,) stamps, ns
    strain : (n, C) V; NaN where missing, saturated or faulty
    lost : number of samples in what cannot be read of the log, if they are as dense there as elsewhere
    notes : what cannot be read, losses, and what the driver would report
    """

    stamp_ns: np.ndarray
    strain: np.ndarray
    lost: int
    notes: list[str]


def read_log(
    path: str | Path,
    protocol: LoadCellProtocol,
    channel: str = "",
    progress: Callable[[str, float], None] = lambda text, fraction: None,
) -> Log:
    """Read the strain in a log: candump -l, .asc, .blf, .trc and what else python-can reads.

    Parameters
    ----------
    path : the log; its suffix is that of the format
    protocol : layout of the frames
    channel : channel to read, as the file names or numbers it; empty: the only one
    progress : called with the path and the fraction of the log that was read

    Raises
    ------
    ScanError
        The log cannot be read, has several channels, no sample of the load cells, or samples of two with the
        same identifiers.
    """
    path = Path(path)
    assembler, cycles, damage = CycleAssembler(protocol), [], _Damage(path)
    senders, back, newest_s = _Senders(assembler.counts), 0, -math.inf
    for frame in _of_channel(path, _frames(path, damage, progress), channel):
        cycles += assembler.feed([frame])
        senders.note(frame)
        back, newest_s = back + (frame.timestamp < newest_s), frame.timestamp
    assembler.reset()
    cycles += assembler.feed([])
    if not cycles:
        raise ScanError("; ".join(damage.notes()) or f"{path}: {_nothing(protocol, assembler.counts, back)}")
    strain = np.array([_usable(protocol, cycle) for cycle in cycles])
    if two := senders.describe_two(protocol, strain):
        raise ScanError(f"{path}: {two}")
    notes = [*damage.notes(), *(f"{path}: {text}" for text in _findings(protocol, assembler.counts))]
    lost = round(len(cycles) * damage.missing / (1.0 - damage.missing))
    return Log(np.array([cycle.stamp_ns for cycle in cycles]), strain, lost, notes)


@dataclass
class _Damage:
    """What cannot be read of a log.

    Attributes
    ----------
    path : the log
    left_out, lines : number of lines that were left out, and of all; 0 where the log has none
    first : the first of them, and why
    read : fraction of the log up to where it could be read
    end : why it could not be read on
    """

    path: Path
    left_out: int = 0
    lines: int = 0
    first: str = ""
    read: float = 1.0
    end: str = ""

    @property
    def missing(self) -> float:
        """Fraction of the log that could not be read, below 1."""
        return min(1.0 - self.read * (1.0 - self.left_out / max(self.lines, 1)), 0.999)

    def notes(self) -> list[str]:
        """A line about those left out, and one about an early end."""
        notes = []
        if self.left_out:
            left_out = f"left out {self.left_out} of {counted(self.lines, 'line')} (first: {self.first})"
            notes.append(f"{self.path}: {_EXPECTED}, {left_out}")
        if self.end:
            up_to = f"could be read up to {self.read:.0%} of it" if self.read else "found another file"
            notes.append(f"{self.path}: {_EXPECTED}, {up_to}: {self.end:.100}")
        return notes


def _frames(
    path: Path, damage: _Damage, progress: Callable[[str, float], None]
) -> Iterator[tuple[str, can.Message]]:
    """Channel, as the file names or numbers it (empty: none), and frame; ends where the log is damaged."""
    try:
        size = max(path.stat().st_size, 1)
        with can.LogReader(path, relative_timestamp=False) as reader:
            is_from_0 = isinstance(reader, _FROM_0)
            try:
                for number, frame in enumerate(_by_line(reader, damage)):
                    if not number % _PROGRESS_FRAMES and (position := _position(reader)):
                        progress(str(path), min(1.0, position / size))
                    yield _channel(frame, is_from_0), frame
            except Exception:
                damage.read = min(1.0, _position(reader) / size)
                raise
            promised = reader.file_size if isinstance(reader, can.BLFReader) else size
            if path.suffix.lower() == ".blf" and size != promised:
                damage.read = min(1.0, size / max(promised, 1))
                damage.end = f"its header says {promised} bytes, it has {size}: cut, or not closed"
    except ScanError:
        raise
    except Exception as error:  # readers raise many types of exceptions
        damage.end = repr(in_one_line(error))


def _channel(frame: can.Message, is_from_0: bool) -> str:
    if frame.channel is None:
        return ""
    return str(frame.channel + 1 if is_from_0 and isinstance(frame.channel, int) else frame.channel)


def _position(reader: MessageReader) -> int:
    """Position in the file of a log, bytes; 0 where it is unknown, or closed at its end."""
    file = getattr(reader, "file", None)
    if file is None or file.closed:
        return 0
    file = getattr(file, "buffer", file)
    return getattr(file, "fileobj", file).tell()  # of a compressed file


def _by_line(reader: MessageReader, damage: _Damage) -> Iterator[can.Message]:
    """Frames of a log; lines that its reader cannot read are left out.

    Raises
    ------
    ScanError
        The stamps are relative.
    Exception
        It cannot be read on, or its header cannot be read.
    """
    if not isinstance(reader, TextIOMessageReader):
        yield from reader
        return
    lines = _Lines(reader.file, damage)
    reader.file = lines  # type: ignore[assignment]  # which reads lines, and nothing else
    has_header, begun = not isinstance(reader, can.CanutilsLogReader), False
    skips = isinstance(reader, can.ASCReader | can.CSVReader)
    while True:
        try:
            for frame in reader:
                if getattr(reader, "timestamps_format", None) == "relative":
                    raise ScanError(f"{damage.path}: expected absolute time stamps, found relative ones")
                begun = True
                yield frame
        except ScanError:
            raise
        except Exception as error:
            if lines.problem or (has_header and not begun):
                raise
            lines.leave_out(in_one_line(error))
            lines.is_next_skipped = skips
        else:
            break


class _Lines:
    """Lines of a log of text, of which the last can be left out, while another iterator of a reader goes on.

    A line without an end is left out too: it can lack digits.

    Attributes
    ----------
    is_next_skipped : whether the reader skips the next line, as a header
    problem : why the file cannot be read on
    """

    def __init__(self, file: Any, damage: _Damage) -> None:
        file.reconfigure(errors="replace")  # bytes that are no text concern one line only
        self._file, self._damage, self._text = file, damage, ""
        self.is_next_skipped = False
        self.problem: Exception | None = None

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)

    def __iter__(self) -> Iterator[str]:
        return self

    def __next__(self) -> str:
        if self.is_next_skipped:
            self.is_next_skipped = False
            return "\n"
        try:
            self._text = next(self._file)
        except (OSError, EOFError, zlib.error) as error:
            self.problem = error
            raise
        self._damage.lines += 1
        if not self._text.endswith("\n"):
            self.leave_out("it has no end")
            raise StopIteration
        return _RAW_LENGTH.sub("", self._text)

    def leave_out(self, reason: str) -> None:
        """Leave out the last line; a new iterator of the reader goes on behind it."""
        damage = self._damage
        damage.left_out += 1
        damage.first = damage.first or f"line {damage.lines} {self._text.strip()[:60]!r}, {reason[:60]!r}"


def _of_channel(path: Path, frames: Iterator[tuple[str, can.Message]], channel: str) -> Iterator[can.Message]:
    """Frames of a channel; empty: the only one."""
    channels: dict[str, None] = {}
    for name, frame in frames:
        if name:
            channels[name] = None
        if name == channel or (not channel and len(channels) < 2):
            yield frame
    there = listed(sorted(channels)) or "none, which the format does not keep"
    if not channel and len(channels) > 1:
        raise ScanError(f"{path}: expected one channel, found {there}; --channel names one of them")
    if channel and channel not in channels:
        raise ScanError(f"{path}: expected the channel {channel}, found {there}")


class _Senders:
    """Evidence for two load cells with the same identifiers, as in a log of two hands without channels.

    Parameters
    ----------
    counts : of the assembler that takes the frames
    """

    def __init__(self, counts: BusCounts) -> None:
        self._counts, self._duplicates, self._repeated = counts, 0, 0
        self._newest: dict[int, bytes] = {}
        self._keeps_channels = False

    def note(self, frame: can.Message) -> None:
        """Note a frame after the assembler has taken it."""
        duplicates, data = self._counts.frames[FrameKind.DUPLICATE], bytes(frame.data)
        if duplicates > self._duplicates:
            self._repeated += data != self._newest.get(frame.arbitration_id)
        self._duplicates, self._newest[frame.arbitration_id] = duplicates, data
        self._keeps_channels = frame.channel is not None

    def describe_two(self, protocol: LoadCellProtocol, strain: np.ndarray) -> str:
        """Why the samples, strain (n, C), are of two load cells; empty if they are not."""
        of_channels = "" if self._keeps_channels else "; two buses? The format keeps no channels"
        if are_of_two(self._repeated, self._counts.cycles):
            reason = f"{self._repeated} frames have the counter of another one and other data"
            return f"{reason}: {TWO_SENDERS}{of_channels}"
        for name, own, channels in zip(
            protocol.phalanges, self._counts.phalanges, protocol.channels.slices, strict=True
        ):
            if are_of_two(own.jumps, own.samples + own.missing) or TWO_SENDERS in own.counter:
                text = describe_counter(own.counter, own.jumps, own.samples + own.missing)
                return f"{name}: {text}{of_channels}"
            if alternates(strain[:, channels]):
                text = f"strain that alternates from sample to sample: {TWO_SENDERS}"
                return f"{name}: {text}{of_channels}"
        return ""


def _findings(protocol: LoadCellProtocol, counts: BusCounts) -> Iterator[str]:
    """What the driver would report of the frames."""
    if discarded := describe_discarded(dict(zip(FrameKind, counts.frames, strict=True))):
        yield discarded
    for name, own in zip(protocol.phalanges, counts.phalanges, strict=True):
        if text := describe_counter(own.counter, own.jumps, own.samples + own.missing):
            yield f"{name}: {text}"
        if own.drops:
            yield f"{own.drops} frames of {name} lost"


def _usable(protocol: LoadCellProtocol, cycle: Cycle) -> np.ndarray:
    bad = (cycle.status & (SATURATED | FAULT)).astype(bool)
    return np.where(bad[protocol.channels.phalanx], np.nan, cycle.strain)


def _nothing(protocol: LoadCellProtocol, counts: BusCounts, back: int) -> str:
    """Why a log has no samples, of which ``back`` frames are earlier than the one before."""
    reasons = [protocol.misfit(frame, slot) for slot, frame in counts.misfits.items() if slot >= 0]
    total = sum(counts.frames)
    if not reasons and counts.frames[FrameKind.UNKNOWN_ID] < total:
        reasons = [f"no sample of {total} frames is complete"]
    if 10 * back > total:
        text = (
            f"{back} of {total} frames are earlier than the one before: times between frames, as of candump"
        )
        reasons.append(f"{text} -t d? -l writes absolute ones")
    return "; ".join(reasons) or f"none of {total} frames has an identifier of the DBC"
