"""Check of the traffic on a bus against a DBC: rates of messages, samples of phalanges, problems."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import can
import numpy as np

from tactile_localizer.io.can.assembler import CycleAssembler
from tactile_localizer.io.can.cycle import Cycle, PhalanxCounts
from tactile_localizer.io.can.frames import ERROR, EXTENDED, REMOTE, frame_key, received_ns
from tactile_localizer.io.can.protocol import FrameKind, LoadCellProtocol
from tactile_localizer.io.status import SATURATED

_NEVER_NS = 10**18
"""A time beyond every timeout, ns: 30 years."""


@dataclass(frozen=True)
class MessageReport:
    """One message of the DBC: identifier, number of frames, their rate and lengths."""

    name: str
    identifier: str
    frames: int
    rate_hz: float
    expected_bytes: int
    found_bytes: tuple[int, ...]


@dataclass(frozen=True)
class PhalanxReport:
    """One phalanx: totals, sampling rate, and ``lowest`` and ``highest`` voltages (c,), V."""

    name: str
    counts: PhalanxCounts
    rate_hz: float
    lowest: np.ndarray
    highest: np.ndarray
    saturated_gauges: tuple[int, ...]


class CanCheck:
    """Checks the frames of a bus or of a log.

    Parameters
    ----------
    protocol : layout of the expected frames
    wait_s : timeout of a cycle, s
    all_required : whether every phalanx is required, or only one
    """

    def __init__(self, protocol: LoadCellProtocol, wait_s: float, all_required: bool) -> None:
        self._protocol = protocol
        self._all_required = all_required
        self._assembler = CycleAssembler(protocol, wait_s)
        self._frames: Counter[int] = Counter()  # by key
        self._lengths: dict[int, set[int]] = {}
        channels = protocol.channels.size
        self._lowest = np.full(channels, np.inf)
        self._highest = np.full(channels, -np.inf)
        self._saturated = np.zeros(channels, dtype=bool)
        self._first_ns: int | None = None
        self._last_ns = 0

    @property
    def frames(self) -> int:
        """Number of frames."""
        return sum(self._assembler.counts.frames)

    @property
    def duration_s(self) -> float:
        """Time from the first frame to the last, s."""
        return 0.0 if self._first_ns is None else (self._last_ns - self._first_ns) * 1e-9

    def feed(self, messages: Sequence[can.Message]) -> None:
        """Process ``messages`` in order of reception."""
        if not messages:
            return
        for message in messages:
            key = frame_key(message)
            self._frames[key] += 1
            self._lengths.setdefault(key, set()).add(len(message.data))
        if self._first_ns is None:
            self._first_ns = received_ns(messages[0])
        self._last_ns = received_ns(messages[-1])
        self._add(self._assembler.feed(messages))

    def finish(self) -> None:
        """Close the last cycle after the last frame."""
        self._add(self._assembler.flush(self._last_ns + _NEVER_NS))

    def _add(self, cycles: list[Cycle]) -> None:
        for cycle in cycles:
            self._lowest = np.fmin(self._lowest, cycle.strain)
            self._highest = np.fmax(self._highest, cycle.strain)
            if any(status & SATURATED for status in cycle.status):
                self._saturated |= self._protocol.saturated(cycle.strain)

    def absent(self) -> list[str]:
        """Phalanges without frames that are not required."""
        if self._all_required:
            return []
        return [name for name in self._protocol.phalanges if name not in self._seen()]

    def messages(self) -> list[MessageReport]:
        """Reports of all messages in use, except those of absent phalanges."""
        absent = self.absent()
        return [
            MessageReport(
                message.definition.name,
                identifier(message.key),
                self._frames[message.key],
                self._rate(self._frames[message.key]),
                message.length,
                tuple(sorted(self._lengths.get(message.key, ()))),
            )
            for message in self._protocol.messages
            if self._protocol.phalanges[message.phalanx] not in absent
        ]

    def phalanges(self) -> list[PhalanxReport]:
        """Reports of all phalanges that are not absent."""
        reports = []
        absent = self.absent()
        for p, (name, counts) in enumerate(
            zip(self._protocol.phalanges, self._assembler.counts.phalanges, strict=True)
        ):
            if name in absent:
                continue
            channels = self._protocol.channels.slices[p]
            gauges = tuple((np.flatnonzero(self._saturated[channels]) + 1).tolist())
            frames = min(
                self._frames[message.key] for message in self._protocol.messages if message.phalanx == p
            )
            rate_hz = self._rate(frames)
            reports.append(
                PhalanxReport(name, counts, rate_hz, self._lowest[channels], self._highest[channels], gauges)
            )
        return reports

    def unknown(self) -> list[tuple[str, int, float]]:
        """Identifier, number of frames and rate of each unknown message, most frequent first."""
        known = {message.key for message in self._protocol.messages}
        return [
            (identifier(key), frames, self._rate(frames))
            for key, frames in self._frames.most_common()
            if key not in known and not key & (ERROR | REMOTE)
        ]

    def problems(self) -> list[str]:
        """Problems, one line each; empty if the hand is ready for use."""
        if not self.frames:
            return ["nothing received: is the interface up, the bit rate right, the hand switched on?"]
        found = [] if self._seen() else ["nothing received that is in the DBC"]
        for message in self.messages():
            if not message.frames:
                found.append(f"{message.name} ({message.identifier}): no frame")
            elif message.found_bytes != (message.expected_bytes,):
                lengths = ", ".join(map(str, message.found_bytes))
                found.append(f"{message.name}: expected {message.expected_bytes} bytes, found {lengths}")
        for phalanx in self.phalanges():
            counts = phalanx.counts
            gauges = f"samples saturated, gauges {' '.join(map(str, phalanx.saturated_gauges))}"
            problems = {
                "frames lost": counts.drops,
                gauges: counts.saturated,
                "samples with a fault": counts.faults,
            }
            found += [f"{phalanx.name}: {what}: {count}" for what, count in problems.items() if count]
        totals = self._assembler.counts.frames
        for kind in (FrameKind.ERROR, FrameKind.REMOTE, FrameKind.DUPLICATE, FrameKind.OUT_OF_ORDER):
            if totals[kind]:
                found.append(f"{kind.name.lower().replace('_', ' ')} frames: {totals[kind]}")
        return found

    def _seen(self) -> set[str]:
        sending = (message.phalanx for message in self._protocol.messages if self._frames[message.key])
        return {self._protocol.phalanges[p] for p in sending}

    def _rate(self, count: int) -> float:
        return (count - 1) / self.duration_s if count > 1 and self.duration_s > 0 else 0.0


def identifier(key: int) -> str:
    """Identifier of a frame's key as text: three hexadecimal digits, or eight if it is extended."""
    return f"{key & 0x1FFFFFFF:0{8 if key & EXTENDED else 3}X}"
