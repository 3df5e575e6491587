"""Messages of the load cells in a DBC, with their gauges, counters and statuses."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import TypeAlias

from can.util import dlc2len, len2dlc
from cantools.database.can import Message, Signal

from tactile_localizer.channels import DEFAULT_CHANNELS, ChannelLayout
from tactile_localizer.errors import CanError
from tactile_localizer.io.can.dbc import PhalanxMessages
from tactile_localizer.io.names import expanded

GAUGE_SIGNALS = tuple(f"gauge_{i + 1}" for i in range(DEFAULT_CHANNELS))
"""Default signal names of the gauge pairs."""

VOLTS = {None: 1.0, "": 1.0, "V": 1.0, "mV": 1e-3, "uV": 1e-6, "\u00b5V": 1e-6, "\u03bcV": 1e-6}
"""Factor from a gauge signal to V, by its unit in the DBC; the last two have micro sign and Greek letter."""

Gauges: TypeAlias = list[tuple[Message, Signal]]


@dataclass(frozen=True)
class SignalNames:
    """Signal names in the DBC, as parameters of the driver node; ``{phalanx}`` stands for a phalanx's name.

    Parameters
    ----------
    gauge_signals : channels in the order of the strain vector; a phalanx may have only the first ones
    counter_signal, status_signal : rolling counter, and status of the load cell; both are optional
    status_ok : values of the status without a fault
    """

    gauge_signals: Sequence[str] = GAUGE_SIGNALS
    counter_signal: str = "counter"
    status_signal: str = "status"
    status_ok: Sequence[int] = (0,)

    def __post_init__(self) -> None:
        gauges = [name for each in self.gauge_signals for name in expanded(each, "gauge signals", CanError)]
        object.__setattr__(self, "gauge_signals", tuple(gauges))
        if not gauges or len(set(gauges)) < len(gauges):
            raise CanError(f"gauge signals: expected unique names, got {', '.join(gauges) or 'none'}")


@dataclass(frozen=True)
class LoadCellMessage:
    """A message of a load cell, or one of its pages: the frames in which a multiplexer has one value.

    Parameters
    ----------
    definition : definition in the DBC
    phalanx : index of the phalanx
    gauges : signals of the gauges in the message, by their column in the strain vector
    counter, status : signals of the counter and the status, ``None`` without one
    selector : signal of the multiplexer, ``None`` without pages
    page : its raw value
    """

    definition: Message
    phalanx: int
    gauges: Mapping[int, Signal]
    counter: Signal | None
    status: Signal | None
    selector: Signal | None = None
    page: int = 0

    @property
    def key(self) -> tuple[int, bool]:
        """Identifier, and whether it has 29 bits."""
        return self.definition.frame_id, bool(self.definition.is_extended_frame)

    @property
    def is_j1939(self) -> bool:
        """Whether the low byte of the identifier is the address of the sender."""
        return self.definition.protocol == "j1939"

    @property
    def name(self) -> str:
        """Identifier and name, as in ``0x110 index``, and the page, as in ``0x110 index (half 1)``."""
        page = f" ({self.selector.name} {self.page})" if self.selector else ""
        return f"0x{self.definition.frame_id:X} {self.definition.name}{page}"

    @cached_property
    def length(self) -> int:
        """Data bytes of a frame on the bus; above 8, CAN FD allows only some lengths."""
        return dlc2len(len2dlc(self.definition.length))

    @property
    def counter_values(self) -> range:
        """Values of the counter by the range in the DBC, or else by its bits; empty without a counter."""
        if self.counter is None:
            return range(0)
        ends = (self.counter.minimum, self.counter.maximum)
        least, most = (
            None if end is None else (end - self.counter.offset) / self.counter.scale for end in ends
        )
        size = 1 << self.counter.length
        if least is None or most is None or not 0 <= least < most < size:
            return range(size)
        return range(int(least), int(most) + 1)


def compile_layout(
    phalanges: Sequence[str], messages: PhalanxMessages, names: SignalNames
) -> tuple[tuple[LoadCellMessage, ...], ChannelLayout]:
    """Find the gauges, counters and statuses in the ``messages`` of ``phalanges``, and their channels.

    Raises
    ------
    CanError
        A gauge is missing, duplicated, scaled by 0 or in a unit other than V, mV or uV; a counter is a
        float; a signal in use has an empty range; gauges of a message are behind several multiplexers, or its
        counter or status is in no frame with gauges; two messages share an identifier.
    """
    found: list[LoadCellMessage] = []
    counts: list[int] = []
    for index, (phalanx, definitions) in enumerate(zip(phalanges, messages, strict=True)):
        gauges = list(enumerate(_gauges_of(phalanx, definitions, names), start=sum(counts)))
        counts.append(len(gauges))
        counter, status = (
            name.replace("{phalanx}", phalanx) for name in (names.counter_signal, names.status_signal)
        )
        own = []
        for message in definitions:
            contained = {column: signal for column, (of, signal) in gauges if of is message}
            beside = [one for one in message.signals if one.name in (counter, status)]
            for signal in (*contained.values(), *beside):
                _check(message, signal)
            for gauge in contained.values():
                _check_gauge(message, gauge)
            own += _pages(message, index, contained, counter, status)
        if any(message.counter and message.counter.is_float for message in own):
            raise CanError(f"phalanx {phalanx!r}: expected an integer {counter!r}, found a float")
        found += own
    for one, other in combinations(found, 2):
        if one.key == other.key and (one.page == other.page or None in (one.selector, other.selector)):
            raise CanError(
                f"message {one.name}: expected it once, found it in {phalanges[one.phalanx]} and "
                f"{phalanges[other.phalanx]}; give boards of one kind their identifiers: "
                f"{one.definition.name}@0x182"
            )
    return tuple(found), ChannelLayout(tuple(counts))


def _gauges_of(phalanx: str, messages: Sequence[Message], names: SignalNames) -> Gauges:
    """The phalanx's gauges, up to the last one in its messages, but at least one.

    Names that each message has, as of the axes of a taxel, are those of the first message, the second, ...
    """
    wanted = [name.replace("{phalanx}", phalanx) for name in names.gauge_signals]
    signals = [(message, signal) for message in messages for signal in message.signals]
    plain = [[pair for pair in signals if pair[0] is one and pair[1].name in wanted] for one in messages]
    alike = {tuple(sorted(signal.name for _, signal in own)) for own in plain if own}
    if len(alike) == 1 and sum(map(bool, plain)) > 1:
        return [pair for own in plain for pair in sorted(own, key=lambda pair: wanted.index(pair[1].name))]
    found: list[Gauges] = [
        [(of, one) for of, one in signals if name in (one.name, f"{of.name}.{one.name}")] for name in wanted
    ]
    last = max((place for place, gauges in enumerate(found) if gauges), default=0)
    for name, gauges in zip(wanted[: last + 1], found, strict=False):
        if len(gauges) != 1:
            raise CanError(
                f"phalanx {phalanx!r}: expected the signal {name!r} once in {_names(messages)}, "
                f"found {len(gauges)}" + ("; write MESSAGE.SIGNAL for one of them" if gauges else "")
            )
    return [gauges[0] for gauges in found[: last + 1]]


def _pages(
    message: Message, phalanx: int, gauges: Mapping[int, Signal], counter: str, status: str
) -> list[LoadCellMessage]:
    """The message, or its pages with gauges, of which the first has also those that are in every frame."""
    by_name = {signal.name: signal for signal in message.signals}
    beside = by_name.get(counter), by_name.get(status)
    selectors = {gauge.multiplexer_signal for gauge in gauges.values() if gauge.multiplexer_ids}
    selector = by_name[selectors.pop()] if selectors else None
    if selectors or (selector and (selector in beside or selector.multiplexer_ids or selector.is_float)):
        where = f"gauges of {message.name}"
        raise CanError(f"{where}: expected them in every frame, or behind one multiplexer that is no other's")
    plain = {column: gauge for column, gauge in gauges.items() if not gauge.multiplexer_ids}
    paged = gauges.keys() - plain.keys()
    pages = sorted({min(gauges[column].multiplexer_ids or ()) for column in paged}) or [0]
    found = []
    for page in pages:
        own = plain if page == pages[0] else {}
        own = own | {each: gauges[each] for each in paged if min(gauges[each].multiplexer_ids or ()) == page}
        counts, says = (one if one and _is_in(one, selector, page) else None for one in beside)
        found.append(LoadCellMessage(message, phalanx, own, counts, says, selector, page))
    for one in filter(None, beside):
        if not any(one in (page.counter, page.status) for page in found):
            where = f"signal {one.name!r} of {message.name}"
            raise CanError(f"{where}: expected it in every frame or with gauges, it is multiplexed")
    return found


def _is_in(signal: Signal, selector: Signal | None, page: int) -> bool:
    """Whether a signal is in the frames of a page."""
    if not signal.multiplexer_ids:
        return True
    return (
        selector is not None and signal.multiplexer_signal == selector.name and page in signal.multiplexer_ids
    )


def _names(messages: Sequence[Message]) -> str:
    return ", ".join(message.name for message in messages)


def _check(message: Message, signal: Signal) -> None:
    """Refuse a signal that has impossible values."""
    where = f"signal {signal.name!r} of {message.name}"
    if signal.length > 64 or (signal.is_float and signal.length not in (16, 32, 64)):
        expected = "a float of 16, 32 or 64" if signal.is_float else "at most 64"
        raise CanError(f"{where}: expected {expected} bits, found {signal.length}")
    if not signal.scale or not math.isfinite(signal.scale):
        raise CanError(f"{where}: expected a scale other than 0, found {signal.scale}")
    lowest, highest = signal.minimum or 0, signal.maximum or 0
    if lowest >= highest and (lowest or highest):  # [0|0] is none
        raise CanError(f"{where}: expected a minimum below the maximum, found [{lowest}|{highest}]")


def _check_gauge(message: Message, gauge: Signal) -> None:
    """Refuse a gauge in another unit, or whose range in the DBC is not one of its bits."""
    where = f"signal {gauge.name!r} of {message.name}"
    if gauge.unit not in VOLTS:
        raise CanError(f"{where}: expected a unit of V, mV or uV, found {gauge.unit!r}")
    lowest, highest = range_of(gauge)
    if lowest >= highest:
        ends = f"[{gauge.minimum}|{gauge.maximum}]"
        raise CanError(f"{where}: expected a range that its bits can have, found {ends}")


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
    lowest, highest = ends
    if signal.minimum or signal.maximum:  # [0|0] is none
        lowest, highest = max(lowest, signal.minimum or 0), min(highest, signal.maximum or 0)
    return lowest * volts, highest * volts


def saturation_of(signal: Signal) -> tuple[float, float]:
    """Ends of the range at which a gauge is saturated, V; infinite where it may rest.

    An unsigned signal rests at its raw zero, such as a taxel without contact. That is no saturation unless
    0 V lies within the range (offset binary), or the DBC gives a narrower range.
    """
    lowest, highest = range_of(signal)
    if not signal.is_signed and not signal.is_float:
        rest = signal.offset * VOLTS[signal.unit]
        if rest == lowest >= 0:
            lowest = -math.inf
        elif rest == highest <= 0:
            highest = math.inf
    return lowest, highest
