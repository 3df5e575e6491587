"""Bit layout of the load cells' messages: a DBC compiled to arrays for vectorised decoding."""

from __future__ import annotations

import logging
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import cantools
import numpy as np
from cantools.database.can import Database, Message, Signal

from tactile_localizer.channels import DEFAULT_CHANNELS, ChannelLayout
from tactile_localizer.errors import CanError
from tactile_localizer.io.can.frames import EXTENDED, MAX_BYTES, wire_length

# cantools logs errors that are raised below as one line.
logging.getLogger("cantools").addHandler(logging.NullHandler())

GAUGE_SIGNALS = tuple(f"gauge_{i + 1}" for i in range(DEFAULT_CHANNELS))
"""Default signal names of the gauge pairs."""

VOLTS = {None: 1.0, "": 1.0, "V": 1.0, "mV": 1e-3, "uV": 1e-6, "µV": 1e-6}
"""Factor from a gauge signal to V, by its unit in the DBC."""

MAX_DBC_BITS = 8 * 1785
"""Largest message size accepted in a DBC, bits: that of J1939's transport protocol, on the same bus."""

_QUOTED = re.compile(r'"(?:\\.|[^"\\])*"')
_SIGNAL_SIZE = re.compile(r"\bSG_\s+(\w{1,500})[^:|]{0,500}:\s*\+?(\d+)\s*\|\s*\+?(\d+)\s*@")
_MESSAGE_SIZE = re.compile(r"\bBO_\s+\d+\s+(\w+)\s*:\s*\+?(\d+)")
_VALUES = re.compile(r"(\d+)\s*-\s*(\d+)")

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
class Layout:
    """Bit layout of M messages with up to S signals each: gauges first, then the counter, then the status.

    Signals that a message does not have are zero in ``mask`` and -1 in ``channel``.

    Attributes
    ----------
    key : (M,) uint32 frame keys
    length : (M,) data bytes of a frame on the bus
    phalanx : (M,) index of the message's phalanx
    counter_bits : (M,) width of the counter, 0 without one
    channel : (M, S - 2) column of each gauge in the strain vector, -1 without one
    start : (M, S, 8) indices of the bytes to gather, least significant first; ``ninth`` (M, S): the next byte
    shift, mask, sign : (M, S) uint64 position, extent and sign bit of the signal in the gathered word
    float_bits : (M, S) width of an IEEE float signal, 0: integer
    scale, offset, volts : (M, S) physical value = (raw * scale + offset) * volts
    lowest, highest : (M, S - 2) V, ends of the range, where a gauge is saturated
    channels : the strain vector's channels by phalanx
    """

    key: np.ndarray
    length: np.ndarray
    phalanx: np.ndarray
    counter_bits: np.ndarray
    channel: np.ndarray
    start: np.ndarray
    ninth: np.ndarray
    shift: np.ndarray
    mask: np.ndarray
    sign: np.ndarray
    float_bits: np.ndarray
    scale: np.ndarray
    offset: np.ndarray
    volts: np.ndarray
    lowest: np.ndarray
    highest: np.ndarray
    channels: ChannelLayout


def load_dbc(path: str | Path) -> Database:
    """Read a CAN database from a DBC file.

    Raises
    ------
    CanError
        The file cannot be read or is not a DBC.
    """
    try:
        text = Path(path).read_text(encoding="cp1252", errors="replace")
        _check_sizes(text)
        database = cantools.database.load_string(text, database_format="dbc", prune_choices=False)
    except OSError as error:
        raise CanError(f"{path}: expected a DBC file, {error.strerror or error}") from error
    except CanError as error:
        raise CanError(f"{path}: {error}") from None
    except (cantools.Error, UnicodeError, ValueError, KeyError, TypeError) as error:
        reason = next(iter(str(error).splitlines()), type(error).__name__)
        raise CanError(f"{path}: expected a DBC file, {reason}") from error
    assert isinstance(database, Database)
    return database


def _check_sizes(text: str) -> None:
    """Refuse sizes for which cantools would allocate gigabytes."""
    text = _QUOTED.sub('""', text)
    for name, start, bits in _SIGNAL_SIZE.findall(text):
        if _exceeds(start, MAX_DBC_BITS) or _exceeds(bits, MAX_DBC_BITS):
            raise CanError(
                f"signal {name!r:.60}: expected at most {MAX_DBC_BITS} bits, got {bits:.12} at {start:.12}"
            )
    for name, size in _MESSAGE_SIZE.findall(text):
        if _exceeds(size, MAX_DBC_BITS // 8):
            raise CanError(
                f"message {name!r:.60}: expected at most {MAX_DBC_BITS // 8} bytes, got {size:.12}"
            )
    for entry in text.split(";"):
        for first, last in _VALUES.findall(entry) if "SG_MUL_VAL_" in entry else ():
            if _exceeds(last, MAX_DBC_BITS):
                raise CanError(f"multiplexed values {first:.12}-{last:.12}: expected at most {MAX_DBC_BITS}")


def _exceeds(number: str, limit: int) -> bool:
    digits = number.lstrip("+0")
    return len(digits) > len(str(limit)) or int(digits or 0) > limit


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
                f"DBC, or a list of its messages, found {_some(by_name)}"
            )
        for name in names:
            if name not in by_name:
                raise CanError(
                    f"phalanx {phalanx!r}: message {name!r} is not in the DBC, which has {_some(by_name)}"
                )
            if name in found:
                raise CanError(
                    f"message {name!r}: expected one phalanx, found {found[name]!r} and {phalanx!r}"
                )
            found[name] = phalanx
        answer.append(tuple(by_name[name] for name in names))
    return tuple(answer)


def phalanges_of(database: Database, names: SignalNames) -> list[str]:
    """Phalanges after which messages of ``database`` are named that have the first gauge pair."""
    found: dict[str, None] = {}
    for message in database.messages:
        phalanx = re.sub("_[A-Za-z0-9]$", "", message.name)
        gauge = names.gauges[0].replace("{phalanx}", phalanx)
        if any(signal.name == gauge for signal in message.signals):
            found[phalanx] = None
    return list(found)


def compile_layout(phalanges: Sequence[str], messages: PhalanxMessages, names: SignalNames) -> Layout:
    """Compile the bit layout of the ``messages`` of ``phalanges``.

    Raises
    ------
    CanError
        A gauge is missing, duplicated, scaled by 0 or in a unit other than V, mV or uV; a message is
        multiplexed or longer than a frame; only some messages of a phalanx have a counter; two messages
        share an identifier.
    """
    rows = []
    counts: list[int] = []
    for index, (phalanx, own) in enumerate(zip(phalanges, messages, strict=True)):
        gauges = _gauges_of(phalanx, own, names)
        first = sum(counts)
        counts.append(len(gauges))
        counter, status = (name.replace("{phalanx}", phalanx) for name in (names.counter, names.status))
        _check(phalanx, own, gauges, counter)
        for message in own:
            by_name = {signal.name: signal for signal in message.signals}
            here = [(first + g, by_name[name]) for g, name in enumerate(gauges) if name in by_name]
            rows.append((index, message, here, by_name.get(counter), by_name.get(status)))
    width = max(len(row[2]) for row in rows)
    layout = _empty_layout(len(rows), width, ChannelLayout(tuple(counts)))
    for m, (index, message, here, counter_signal, status_signal) in enumerate(rows):
        layout.key[m] = message.frame_id | (EXTENDED if message.is_extended_frame else 0)
        layout.length[m] = wire_length(message.length)
        layout.phalanx[m] = index
        for s, (channel, signal) in enumerate(here):
            layout.channel[m, s] = channel
            _place(layout, m, s, message, signal)
            layout.volts[m, s] = VOLTS[signal.unit]
            layout.lowest[m, s], layout.highest[m, s] = _range(signal)
        if counter_signal is not None:
            _place(layout, m, width, message, counter_signal)
            layout.counter_bits[m] = counter_signal.length
        if status_signal is not None:
            _place(layout, m, width + 1, message, status_signal)
    for key in layout.key.tolist():
        shared = [rows[m][1].name for m in np.flatnonzero(layout.key == key)]
        if len(shared) > 1:
            raise CanError(f"frame 0x{key & 0x1FFFFFFF:X}: expected one message, found {', '.join(shared)}")
    return layout


def _gauges_of(phalanx: str, messages: Sequence[Message], names: SignalNames) -> list[str]:
    """Names of the phalanx's gauges, up to the last one in its messages, but at least one."""
    gauges = [name.replace("{phalanx}", phalanx) for name in names.gauges]
    found = {signal.name for message in messages for signal in message.signals}
    last = max((number for number, name in enumerate(gauges, start=1) if name in found), default=1)
    return gauges[:last]


def _check(phalanx: str, messages: Sequence[Message], gauges: Sequence[str], counter: str) -> None:
    signals = [signal for message in messages for signal in message.signals]
    where = ", ".join(message.name for message in messages)
    for gauge in gauges:
        found = [signal for signal in signals if signal.name == gauge]
        if len(found) != 1:
            raise CanError(
                f"phalanx {phalanx!r}: expected the signal {gauge!r} once in {where}, found {len(found)}"
            )
        if found[0].unit not in VOLTS:
            raise CanError(
                f"signal {gauge!r} of {where}: expected a unit of V, mV or uV, found {found[0].unit!r}"
            )
        if found[0].length > 64:
            raise CanError(f"signal {gauge!r} of {where}: expected at most 64 bits, found {found[0].length}")
        if not found[0].scale:
            raise CanError(f"signal {gauge!r} of {where}: expected a scale other than 0, found 0")
    counters = {signal.length for signal in signals if signal.name == counter}
    having = sum(any(signal.name == counter for signal in message.signals) for message in messages)
    if having not in (0, len(messages)) or len(counters) > 1:
        raise CanError(
            f"phalanx {phalanx!r}: expected {counter!r} of one width in all of {where}, or in none"
        )
    for message in messages:
        if message.is_multiplexed():
            raise CanError(f"message {message.name!r}: expected no multiplexed signals, found some")
        if message.length > MAX_BYTES:
            raise CanError(
                f"message {message.name!r}: expected at most {MAX_BYTES} bytes, got {message.length}"
            )


def _empty_layout(messages: int, gauges: int, channels: ChannelLayout) -> Layout:
    def table(dtype: type, *more: int, columns: int = gauges + 2) -> np.ndarray:
        return np.zeros((messages, columns, *more), dtype=dtype)

    return Layout(
        key=np.zeros(messages, np.uint32),
        length=np.zeros(messages, np.int64),
        phalanx=np.zeros(messages, np.intp),
        counter_bits=np.zeros(messages, np.int64),
        channel=np.full((messages, gauges), -1, dtype=np.intp),
        start=table(np.intp, 8),
        ninth=table(np.intp),
        shift=table(np.uint64),
        mask=table(np.uint64),
        sign=table(np.uint64),
        float_bits=table(np.int64),
        scale=table(np.float64),
        offset=table(np.float64),
        volts=np.ones((messages, gauges)),
        lowest=np.full((messages, gauges), -np.inf),
        highest=np.full((messages, gauges), np.inf),
        channels=channels,
    )


def _place(layout: Layout, m: int, s: int, message: Message, signal: Signal) -> None:
    # The bytes of the signal are gathered from the least significant one on. Bytes beyond the frame only
    # affect bits that the mask clears, so their indices are clipped.
    if signal.byte_order == "little_endian":
        lowest_byte, shift, step = signal.start // 8, signal.start % 8, 1
    else:
        most_significant = 8 * (signal.start // 8) + 7 - signal.start % 8
        least_significant = most_significant + signal.length - 1
        lowest_byte, shift, step = least_significant // 8, 7 - least_significant % 8, -1
    places = np.clip(lowest_byte + step * np.arange(9), 0, message.length - 1)
    layout.start[m, s] = places[:8]
    layout.ninth[m, s] = places[8]
    layout.shift[m, s] = shift
    layout.mask[m, s] = (1 << signal.length) - 1
    layout.sign[m, s] = 1 << (signal.length - 1) if signal.is_signed and not signal.is_float else 0
    layout.float_bits[m, s] = signal.length if signal.is_float else 0
    layout.scale[m, s] = signal.scale
    layout.offset[m, s] = signal.offset


def raw_range(signal: Signal) -> tuple[float, float]:
    """Smallest and largest raw value of ``signal``; infinite for a float."""
    if signal.is_float:
        return -np.inf, np.inf
    if signal.is_signed:
        return -(1 << (signal.length - 1)), (1 << (signal.length - 1)) - 1
    return 0, (1 << signal.length) - 1


def _range(signal: Signal) -> tuple[float, float]:
    # The narrower of the ranges given by the number of bits and by the DBC.
    ends = sorted(float(raw) * signal.scale + signal.offset for raw in raw_range(signal))
    lowest = ends[0] if signal.minimum is None else max(ends[0], signal.minimum)
    highest = ends[1] if signal.maximum is None else min(ends[1], signal.maximum)
    return lowest * VOLTS[signal.unit], highest * VOLTS[signal.unit]


def _some(names: Mapping[str, object]) -> str:
    shown = list(names)[:8]
    return ", ".join(shown) + (", ..." if len(names) > len(shown) else "") if shown else "no messages"
