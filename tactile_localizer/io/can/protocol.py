"""Decoding of CAN frames to volts and encoding of volts to frames, according to a DBC."""

import enum
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, Literal

import can
import numpy as np
from cantools.database.can import Signal

from tactile_localizer.errors import listed
from tactile_localizer.io.can.dbc import read_messages
from tactile_localizer.io.can.layout import (
    VOLTS,
    LoadCellMessage,
    SignalNames,
    bits_of,
    compile_layout,
    range_of,
    saturation_of,
)
from tactile_localizer.io.status import FAULT, SATURATED
from tactile_localizer.resources import given_or_shipped

_GROUP = 0x03FFFF00
"""Mask of an identifier of SAE J1939 without its priority and the address of its sender."""

Place = tuple[Literal["little", "big"], int, int]
"""Byte order, shift and mask of a number in the data of a frame."""


class FrameKind(enum.IntEnum):
    """Kind of a frame; the assembler determines the last three."""

    DATA = 0
    UNKNOWN_ID = 1
    WRONG_LENGTH = 2
    REMOTE = 3
    ERROR = 4
    DUPLICATE = 5
    OUT_OF_ORDER = 6
    LATE = 7
    UNKNOWN_PAGE = 8


class LoadCellProtocol:
    """Frame format of a hand's load cells, read from a DBC file.

    It is stateless; :class:`~tactile_localizer.io.can.assembler.CycleAssembler` assigns frames to cycles.

    Parameters
    ----------
    path : DBC file
    phalanges : names, in the order of the strain vector
    messages : names of the messages by phalanx; default: those named after the phalanx
    names : signal names in the DBC

    Attributes
    ----------
    phalanges : names, in the order of the strain vector
    messages : of all phalanges
    channels : channels of the strain vector by phalanx
    is_fd : whether any message needs CAN FD
    size : bytes of the frames of one cycle, one frame of each message

    Raises
    ------
    CanError
        The file is not a DBC, or lacks a message or signal of a phalanx.
    """

    def __init__(
        self,
        path: str | Path,
        phalanges: Sequence[str],
        messages: Mapping[str, Sequence[str]] | None = None,
        names: SignalNames | None = None,
    ) -> None:
        self.phalanges = tuple(phalanges)
        definitions, names = read_messages(path, phalanges, messages or {}), names or SignalNames()
        self.messages, self.channels = compile_layout(self.phalanges, definitions, names)
        self._status_ok = frozenset(names.status_ok)
        self.is_fd = any(message.length > 8 or message.definition.is_fd for message in self.messages)
        self._slots = {message.key: slot for slot, message in enumerate(self.messages)}
        self._selectors = {one.key: _shift_of(one, one.selector) for one in self.messages if one.selector}
        self._pages = {(one.key, one.page): slot for slot, one in enumerate(self.messages) if one.selector}
        self._similar = {(key[0], not key[1]): slot for key, slot in self._slots.items()}
        self._similar |= {
            (number & _GROUP, True): slot for (number, _), slot in self._slots.items() if number > 0x7FF
        }
        self._ends = np.cumsum([message.length for message in self.messages]).tolist()
        self.size = self._ends[-1]
        self._counters = [_shift_of(message, message.counter) for message in self.messages]
        self._compile()

    def _compile(self) -> None:
        """Prepare the decoding of all gauges and statuses at once: S signals, the first C of them gauges.

        Bits above a signal's own repeat its sign, or are those of a byte of zeros behind the frames.
        """
        gauges = {
            column: (signal, slot)
            for slot, message in enumerate(self.messages)
            for column, signal in message.gauges.items()
        }
        statuses = [(message.status, slot) for slot, message in enumerate(self.messages) if message.status]
        signals = [gauges[column] for column in range(self.channels.size)] + statuses
        width = next(bits for bits in (8, 16, 32, 64) if bits >= max(one.length for one, _ in signals))
        zero = 8 * self.size
        bits_of_row, kinds = [], dict[str, list[int]]()
        for row, (signal, slot) in enumerate(signals):
            bits = [8 * self.bytes_of(slot).start + bit for bit in bits_of(signal)]
            above = bits[-1] if signal.is_signed else zero
            bits_of_row.append(bits + [above] * (width - len(bits)))
            is_unsigned = not signal.is_signed and signal.length == width  # of fewer bits, the highest is 0
            letter = "f" if signal.is_float else "u" if is_unsigned else "i"
            size = signal.length if signal.is_float else width
            kinds.setdefault(f"<{letter}{size // 8}", []).append(row)
        self._bits = np.array([bits_of_row[row] for rows in kinds.values() for row in rows]).ravel()
        self._kinds, end = list[tuple[str, slice, int, np.ndarray]](), 0
        for kind, rows in kinds.items():
            begin, end = end, end + len(rows) * width // 8
            self._kinds.append((kind, slice(begin, end), width // 8 // int(kind[2:]), np.array(rows)))
        own = [signal for signal, _ in signals[: self.channels.size]]
        self._volts = np.array([VOLTS[one.unit] for one in own])
        self._scale, self._offset = self._volts * np.array([(float(a.scale), float(a.offset)) for a in own]).T
        self._lowest, self._highest = np.array([range_of(one) for one in own]).T
        self._below, self._above = np.array([saturation_of(one) for one in own]).T
        self._statuses = [signal for signal, _ in statuses]
        self._status_phalanx = np.array([self.messages[slot].phalanx for _, slot in statuses], int)

    @property
    def filters(self) -> list[can.typechecking.CanFilter]:
        """Filters for the kernel that pass the messages in use, and frames for :meth:`misfit`."""
        return [
            {
                "can_id": message.definition.frame_id,
                "can_mask": _GROUP if message.is_j1939 else 0x1FFFFFFF,
                "extended": extended,
            }
            for message in {message.key: message for message in self.messages}.values()
            for extended in (False, True)
        ]

    def bytes_of(self, slot: int) -> slice:
        """Place of a message's frame in the data of a cycle."""
        return slice(self._ends[slot] - self.messages[slot].length, self._ends[slot])

    def classify(self, frame: can.Message) -> tuple[FrameKind, int, int]:
        """Kind of a frame, index of its message or of the most similar one (-1: none), and its counter.

        The counter is 0 without one. Never raises, whatever the content of the frame.
        """
        number, extended = frame.arbitration_id, frame.is_extended_id
        slot = self._slots.get((number, extended), -1)
        if frame.is_error_frame:
            return FrameKind.ERROR, slot, 0
        if frame.is_remote_frame:
            return FrameKind.REMOTE, slot, 0
        if slot < 0:
            group = number & _GROUP
            slot = self._similar.get((number, extended), self._similar.get((group, extended), -1))
            return FrameKind.UNKNOWN_ID, slot, 0
        if len(frame.data) != self.messages[slot].length:
            return FrameKind.WRONG_LENGTH, slot, 0
        if selector := self._selectors.get((number, extended)):
            own = self._pages.get(((number, extended), _number_at(selector, frame.data)))
            if own is None:
                return FrameKind.UNKNOWN_PAGE, slot, 0
            slot = own
        return FrameKind.DATA, slot, _number_at(self._counters[slot], frame.data)

    def misfit(self, frame: can.Message, slot: int) -> str:
        """Why a frame is not used that has or resembles the identifier of a message, in words."""
        message, number = self.messages[slot], frame.arbitration_id
        if frame.is_remote_frame:
            return f"{message.name}: remote frames"
        if number != message.key[0]:
            return (
                f"0x{number:X} differs from {message.name} only in its priority or the address of its sender"
                f": set messages.{self.phalanges[message.phalanx]} to {message.definition.name}@0x{number:X}"
            )
        if len(frame.data) == message.length and message.selector:
            value = _number_at(self._selectors[message.key], frame.data)
            own = listed(str(one.page) for one in self.messages if one.key == message.key)
            return f"0x{number:X} {message.definition.name}: {message.selector.name} {value} instead of {own}"
        if frame.is_extended_id != message.key[1]:
            found, expected = (29, 11) if frame.is_extended_id else (11, 29)
            return f"{message.name}: an identifier of {found} bits instead of {expected}"
        return f"{message.name}: {len(frame.data)} bytes instead of {message.length}"

    def decode(self, data: bytes | bytearray) -> tuple[np.ndarray, np.ndarray]:
        """Decode the frames of one cycle.

        Parameters
        ----------
        data : :attr:`size` bytes, in the order of :attr:`messages`

        Returns
        -------
        strain : (C,) V
        status : (F,) uint8 bits ``SATURATED`` and ``FAULT`` of :mod:`~tactile_localizer.io.status`
        """
        strain, statuses = self._values(data)
        status = np.zeros(len(self.phalanges), np.uint8)
        is_inside = (self._below < strain) & (strain < self._above)
        if not is_inside.all():
            is_finite = np.isfinite(strain)
            status[self.channels.phalanx[~is_inside & is_finite]] |= SATURATED
            status[self.channels.phalanx[~is_finite]] |= FAULT
        if not self._status_ok.issuperset(statuses.tolist()):
            is_fault = [value not in self._status_ok for value in statuses.tolist()]
            status[self._status_phalanx[is_fault]] |= FAULT
        return strain, status

    def _values(self, data: bytes | bytearray) -> tuple[np.ndarray, np.ndarray]:
        """Strain (C,), V, and the raw statuses in the order of :attr:`messages`."""
        bits = np.unpackbits(np.frombuffer(data + b"\0", np.uint8), bitorder="little")
        words = np.packbits(bits.take(self._bits), bitorder="little")
        raw = np.empty(self.channels.size + len(self._statuses))
        with np.errstate(all="ignore"):  # floats can be anything
            for kind, place, step, rows in self._kinds:
                raw[rows] = words[place].view(kind)[::step]
            strain = raw[: self.channels.size] * self._scale + self._offset
        return strain, raw[self.channels.size :]

    def explain(self, phalanx: int, data: bytes) -> str:
        """The values in the data of a cycle for which a phalanx is ``SATURATED`` or ``FAULT``, in words."""
        strain, statuses = self._values(data)
        found = []
        for signal, value, of in zip(self._statuses, statuses, self._status_phalanx, strict=True):
            if of == phalanx and value not in self._status_ok:
                name = signal.choices.get(int(value)) if signal.choices else None
                found.append(
                    f"{signal.name} {value:.0f}" + (f" ({name})" if name else "") + " is not in status_ok"
                )
        for message in self.messages:
            for column, gauge in message.gauges.items() if message.phalanx == phalanx else ():
                if not self._below[column] < strain[column] < self._above[column]:
                    ends = f"[{gauge.minimum}|{gauge.maximum}] {gauge.unit or 'V'} in the DBC"
                    ends = ends if gauge.minimum or gauge.maximum else "of its bits"
                    found.append(f"{gauge.name} is {strain[column]:.4g} V, with the range {ends}")
        return ", ".join(found[:2])

    def encode(
        self, phalanx: int, strain: np.ndarray, sequence: int, status: int = 0, stamp_s: float = 0.0
    ) -> list[can.Message]:
        """Encode one sample of a load cell as frames, in the order of its messages.

        Parameters
        ----------
        phalanx : index of the phalanx
        strain : (c,) voltages of its channels, V; clipped to the range, as by an amplifier
        sequence : number of the sample; its low bits become the counter
        status : status of the load cell; 0: no fault
        stamp_s : time stamp of the frames, s
        """
        frames = []
        first = self.channels.slices[phalanx].start
        for message in self.messages:
            if message.phalanx != phalanx:
                continue
            values: dict[str, float] = {signal.name: 0 for signal in message.definition.signals}
            for signal in message.definition.signals:
                if signal.multiplexer_signal and signal.multiplexer_ids:
                    values[signal.multiplexer_signal] = min(signal.multiplexer_ids)
            for column, gauge in message.gauges.items():
                volts = np.clip(strain[column - first], self._lowest[column], self._highest[column])
                values[gauge.name] = gauge.scaled_to_raw(float(volts / self._volts[column]))
            if message.selector:
                values[message.selector.name] = message.page
            if message.counter:
                counts = message.counter_values
                values[message.counter.name] = counts[sequence % len(counts)]
            if message.status:
                values[message.status.name] = status
            data = message.definition.encode(values, scaling=False, strict=False)
            frames.append(
                can.Message(
                    timestamp=stamp_s,
                    arbitration_id=message.definition.frame_id,
                    is_extended_id=message.definition.is_extended_frame,
                    is_fd=self.is_fd,
                    data=data.ljust(message.length, b"\0"),
                )
            )
        return frames


def protocol_of(phalanges: Sequence[str], parameters: Mapping[str, Any]) -> LoadCellProtocol:
    """The protocol of phalanges by parameters of the driver node, of which all but ``dbc`` have defaults.

    Raises
    ------
    CanError
        As :class:`LoadCellProtocol`.
    """
    messages = {name: parameters.get(f"messages.{name}", ()) for name in phalanges}
    names = {each.name: parameters[each.name] for each in fields(SignalNames) if each.name in parameters}
    dbc = given_or_shipped(parameters["dbc"], "config")
    return LoadCellProtocol(dbc, phalanges, messages, SignalNames(**names))


def _shift_of(message: LoadCellMessage, signal: Signal | None) -> Place:
    """Place of a number in a message; ``None``: there is none, and it is 0."""
    if signal is None:
        return "little", 0, 0
    mask = (1 << signal.length) - 1
    lowest = bits_of(signal)[0]
    if signal.byte_order == "little_endian":
        return "little", lowest, mask
    return "big", 8 * message.length - 1 - (lowest ^ 7), mask


def _number_at(place: Place, data: bytes | bytearray) -> int:
    order, shift, mask = place
    return int.from_bytes(data, order) >> shift & mask if mask else 0
