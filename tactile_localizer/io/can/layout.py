"""Messages of the load cells in a DBC, with their gauges, counters and statuses."""

from __future__ import annotations

import logging
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TypeAlias

import cantools
from can.util import dlc2len, len2dlc
from cantools.database.can import Database, Message, Signal

from tactile_localizer.channels import DEFAULT_CHANNELS, ChannelLayout
from tactile_localizer.errors import CanError, listed

# cantools logs errors that are raised below as one line.
logging.getLogger("cantools").addHandler(logging.NullHandler())

GAUGE_SIGNALS = tuple(f"gauge_{i + 1}" for i in range(DEFAULT_CHANNELS))
"""Default signal names of the gauge pairs."""

VOLTS = {None: 1.0, "": 1.0, "V": 1.0, "mV": 1e-3, "uV": 1e-6, "µV": 1e-6}
"""Factor from a gauge signal to V, by its unit in the DBC."""

MAX_BYTES = 64
"""Data bytes of the longest CAN FD frame."""

PhalanxMessages: TypeAlias = tuple[tuple[Message, ...], ...]


@dataclass(frozen=True)
class SignalNames:
    """Signal names in the DBC; ``{phalanx}`` is replaced by the name of the phalanx.

    Parameters
    ----------
    gauges : channels in the order of the strain vector; a phalanx may have only the first ones
    counter, status : rolling counter, and status of the load cell (0: no fault); both are optional
    """

    gauges: tuple[str, ...] = GAUGE_SIGNALS
    counter: str = "counter"
    status: str = "status"

    def __post_init__(self) -> None:
        if not self.gauges or len(set(self.gauges)) < len(self.gauges):
            raise CanError(f"gauge signals: expected unique names, got {', '.join(self.gauges) or 'none'}")


@dataclass(frozen=True)
class LoadCellMessage:
    """A message of a load cell.

    Parameters
    ----------
    definition : definition in the DBC
    phalanx : index of the phalanx
    gauges : signals of the gauges in the message, by their column in the strain vector
    counter, status : signals of the counter and the status, ``None`` without one
    """

    definition: Message
    phalanx: int
    gauges: Mapping[int, Signal]
    counter: Signal | None
    status: Signal | None

    @property
    def key(self) -> tuple[int, bool]:
        """Identifier, and whether it has 29 bits."""
        return self.definition.frame_id, bool(self.definition.is_extended_frame)

    @cached_property
    def length(self) -> int:
        """Data bytes of a frame on the bus; above 8, CAN FD allows only some lengths."""
        return dlc2len(len2dlc(self.definition.length))

    @property
    def counter_span(self) -> int:
        """Number of values of the counter, 0 without one."""
        return 1 << self.counter.length if self.counter else 0


def load_dbc(path: str | Path) -> Database:
    """Read a CAN database from a DBC file.

    Raises
    ------
    CanError
        The file cannot be read or is not a DBC.
    """
    try:
        text = Path(path).read_text(encoding="cp1252", errors="replace")
        database = cantools.database.load_string(text, database_format="dbc", prune_choices=False)
    except (OSError, cantools.Error, UnicodeError, ValueError, KeyError, TypeError) as error:
        strerror = getattr(error, "strerror", None)
        reason = strerror or next(iter(str(error).splitlines()), type(error).__name__)
        raise CanError(f"{path}: expected a DBC file, {reason}") from error
    assert isinstance(database, Database)
    return database


def phalanx_messages(
    database: Database, phalanges: Sequence[str], messages: Mapping[str, Sequence[str]]
) -> PhalanxMessages:
    """Messages of each phalanx: those listed in ``messages``, or else those named after the phalanx.

    Messages of the phalanx ``index`` are ``index``, and ``index_`` with one letter or digit.

    Raises
    ------
    CanError
        A phalanx has no message, or a message belongs to two phalanges.
    """
    by_name = {message.name: message for message in database.messages}
    found: dict[str, str] = {}
    answer = []
    for phalanx in phalanges:
        pattern = re.compile(re.escape(phalanx) + "(_[A-Za-z0-9])?")
        names = list(messages.get(phalanx, ())) or [name for name in by_name if pattern.fullmatch(name)]
        if not names:
            raise CanError(
                f"phalanx {phalanx!r}: expected a message {phalanx} or {phalanx}_a, {phalanx}_b, ... in the "
                f"DBC, or a list of its messages, found {listed(by_name) or 'no messages'}"
            )
        for name in names:
            if name not in by_name:
                raise CanError(
                    f"phalanx {phalanx!r}: message {name!r} is not in the DBC, which has {listed(by_name)}"
                )
            if name in found:
                raise CanError(
                    f"message {name!r}: expected one phalanx, found {found[name]!r} and {phalanx!r}"
                )
            found[name] = phalanx
        answer.append(tuple(by_name[name] for name in names))
    return tuple(answer)


def compile_layout(
    phalanges: Sequence[str], messages: PhalanxMessages, names: SignalNames
) -> tuple[tuple[LoadCellMessage, ...], ChannelLayout]:
    """Find the gauges, counters and statuses in the ``messages`` of ``phalanges``, and their channels.

    Raises
    ------
    CanError
        A gauge is missing, duplicated, scaled by 0 or in a unit other than V, mV or uV; a counter is a
        float; a message is multiplexed or longer than a frame; only some messages of a phalanx have a
        counter; two messages share an identifier.
    """
    found: list[LoadCellMessage] = []
    counts: list[int] = []
    for index, (phalanx, definitions) in enumerate(zip(phalanges, messages, strict=True)):
        gauges = _gauges_of(phalanx, definitions, names)
        columns = {name: column for column, name in enumerate(gauges, start=sum(counts))}
        counts.append(len(gauges))
        counter, status = (name.replace("{phalanx}", phalanx) for name in (names.counter, names.status))
        own = []
        for message in definitions:
            _check_message(message)
            by_name = {signal.name: signal for signal in message.signals}
            contained = {columns[name]: signal for name, signal in by_name.items() if name in columns}
            own.append(LoadCellMessage(message, index, contained, by_name.get(counter), by_name.get(status)))
        if len({message.counter_span for message in own}) > 1:
            raise CanError(
                f"phalanx {phalanx!r}: expected {counter!r} of one width in all of {_names(definitions)}, "
                "or in none"
            )
        if any(message.counter and message.counter.is_float for message in own):
            raise CanError(f"phalanx {phalanx!r}: expected an integer {counter!r}, found a float")
        found += own
    for key in {message.key for message in found}:
        shared = [message.definition.name for message in found if message.key == key]
        if len(shared) > 1:
            raise CanError(f"frame 0x{key[0]:X}: expected one message, found {', '.join(shared)}")
    return tuple(found), ChannelLayout(tuple(counts))


def _gauges_of(phalanx: str, messages: Sequence[Message], names: SignalNames) -> list[str]:
    """Names of the phalanx's gauges, up to the last one in its messages, but at least one."""
    gauges = [name.replace("{phalanx}", phalanx) for name in names.gauges]
    signals = [signal for message in messages for signal in message.signals]
    last = max((gauges.index(signal.name) for signal in signals if signal.name in gauges), default=0)
    for gauge in gauges[: last + 1]:
        found = [signal for signal in signals if signal.name == gauge]
        if len(found) != 1:
            raise CanError(
                f"phalanx {phalanx!r}: expected the signal {gauge!r} once in {_names(messages)}, "
                f"found {len(found)}"
            )
        where = f"signal {gauge!r} of {_names(messages)}"
        if found[0].unit not in VOLTS:
            raise CanError(f"{where}: expected a unit of V, mV or uV, found {found[0].unit!r}")
        if found[0].length > 64:
            raise CanError(f"{where}: expected at most 64 bits, found {found[0].length}")
        if not found[0].scale:
            raise CanError(f"{where}: expected a scale other than 0, found 0")
    return gauges[: last + 1]


def _names(messages: Sequence[Message]) -> str:
    return ", ".join(message.name for message in messages)


def _check_message(message: Message) -> None:
    if message.is_multiplexed():
        raise CanError(f"message {message.name!r}: expected no multiplexed signals, found some")
    if message.length > MAX_BYTES:
        raise CanError(f"message {message.name!r}: expected at most {MAX_BYTES} bytes, got {message.length}")


def bits_of(signal: Signal) -> list[int]:
    """Numbers of the bits of ``signal`` in its message, the least significant first."""
    if signal.byte_order == "little_endian":
        return list(range(signal.start, signal.start + signal.length))
    first = signal.start ^ 7  # bits count down in a byte, and bytes count up
    return [place ^ 7 for place in reversed(range(first, first + signal.length))]


def range_of(signal: Signal) -> tuple[float, float]:
    """Ends of the range of a gauge, V: the narrower of those given by its bits and by the DBC."""
    volts, least = VOLTS[signal.unit], -(1 << (signal.length - 1)) if signal.is_signed else 0
    ends = sorted(raw * signal.scale + signal.offset for raw in (least, least + (1 << signal.length) - 1))
    if signal.is_float:
        ends = [-math.inf, math.inf]
    lowest = ends[0] if signal.minimum is None else max(ends[0], signal.minimum)
    highest = ends[1] if signal.maximum is None else min(ends[1], signal.maximum)
    return lowest * volts, highest * volts
