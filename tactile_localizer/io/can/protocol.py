"""Decoding of CAN frames to volts and encoding of volts to frames, according to a DBC."""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import can
import numpy as np
from cantools.database.can import Signal

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.io.can.frames import ERROR, REMOTE, FrameBatch, wire_length
from tactile_localizer.io.can.layout import (
    VOLTS,
    Layout,
    PhalanxMessages,
    SignalNames,
    compile_layout,
    load_dbc,
    phalanx_messages,
    raw_range,
)


class FrameKind(enum.IntEnum):
    """Classification of a frame; the assembler reclassifies some ``DATA`` frames to the last two kinds."""

    DATA = 0
    UNKNOWN_ID = 1
    WRONG_LENGTH = 2
    REMOTE = 3
    ERROR = 4
    DUPLICATE = 5
    OUT_OF_ORDER = 6


@dataclass(frozen=True)
class Decoded:
    """Content of N decoded frames.

    Attributes
    ----------
    kind : (N,) uint8 of :class:`FrameKind`; the other attributes are valid for ``DATA`` only
    slot : (N,) index of the message, in the order of :attr:`LoadCellProtocol.layout`
    counter : (N,) uint64 rolling counter, 0 if the message has none
    fault : (N,) bool, the load cell's status is not 0, or a voltage is not finite
    saturated : (N,) bool, a gauge pair is at an end of its range
    voltage : (N, G) voltages of the message's gauges, V; columns beyond its gauges are undefined
    """

    kind: np.ndarray
    slot: np.ndarray
    counter: np.ndarray
    fault: np.ndarray
    saturated: np.ndarray
    voltage: np.ndarray


class LoadCellProtocol:
    """Frame format of a hand's load cells, made by :meth:`from_dbc`.

    It is stateless; :class:`~tactile_localizer.io.can.assembler.CycleAssembler` assigns frames to cycles.

    Attributes
    ----------
    phalanges : names, in the order of the strain vector
    layout : bit layout of the messages
    width : data bytes of the longest frame
    is_fd : whether any message needs CAN FD
    """

    def __init__(self, phalanges: Sequence[str], messages: PhalanxMessages, names: SignalNames) -> None:
        self.phalanges = tuple(phalanges)
        self.layout: Layout = compile_layout(self.phalanges, messages, names)
        self.width = int(self.layout.length.max())
        self.is_fd = self.width > 8 or any(message.is_fd for own in messages for message in own)
        self._messages = messages
        self._names = names
        self._readers = {key: _Reader(self.layout, m) for m, key in enumerate(self.layout.key.tolist())}

    @classmethod
    def from_dbc(
        cls,
        path: str | Path,
        phalanges: Sequence[str],
        messages: Mapping[str, Sequence[str]] | None = None,
        names: SignalNames | None = None,
    ) -> LoadCellProtocol:
        """Read the frame format of the load cells of ``phalanges`` from a DBC file.

        Parameters
        ----------
        path : DBC file
        phalanges : names, in the order of the strain vector
        messages : names of the messages by phalanx; default: those named after the phalanx
        names : signal names in the DBC

        Raises
        ------
        CanError
            The file is not a DBC, or lacks a message or signal of a phalanx.
        """
        own = phalanx_messages(load_dbc(path), phalanges, messages or {})
        return cls(phalanges, own, names or SignalNames())

    @property
    def channels(self) -> ChannelLayout:
        """Channels of the strain vector by phalanx."""
        return self.layout.channels

    @property
    def message_names(self) -> tuple[str, ...]:
        """Name of each message, in the order of :attr:`layout`."""
        return tuple(message.name for own in self._messages for message in own)

    @property
    def filters(self) -> list[can.typechecking.CanFilter]:
        """Filters for the kernel or the adapter that pass exactly the messages in use."""
        return [
            {"can_id": message.frame_id, "can_mask": 0x1FFFFFFF if extended else 0x7FF, "extended": extended}
            for own in self._messages
            for message in own
            for extended in [bool(message.is_extended_frame)]
        ]

    def batch(self, messages: Sequence[can.Message]) -> FrameBatch:
        """Convert python-can ``messages`` to arrays with the width of the longest frame."""
        return FrameBatch.from_messages(messages, self.width)

    def decode(self, frames: FrameBatch) -> Decoded:
        """Decode ``frames``; never raises, whatever their content."""
        count = len(frames)
        kind, slot = np.zeros(count, np.uint8), np.zeros(count, np.intp)
        counter = np.zeros(count, np.uint64)
        fault, saturated = np.zeros(count, bool), np.zeros(count, bool)
        voltage = np.zeros((count, self.layout.channel.shape[1]))
        # A message at a time: live batches have few frames, for which arrays cost more than cantools does.
        for row, (key, length) in enumerate(zip(frames.key.tolist(), frames.length.tolist(), strict=True)):
            reader = self._readers.get(key)
            if reader is None:
                flag = FrameKind.REMOTE if key & REMOTE else FrameKind.UNKNOWN_ID
                kind[row] = FrameKind.ERROR if key & ERROR else flag
            elif length != reader.length:
                kind[row] = FrameKind.WRONG_LENGTH
            else:
                slot[row] = reader.slot
                sample = reader.read(frames.data[row].tobytes())
                counter[row], fault[row], saturated[row], volts = sample
                voltage[row, : len(volts)] = volts
        return Decoded(kind, slot, counter, fault, saturated, voltage)

    def saturated(self, strain: np.ndarray) -> np.ndarray:
        """Whether each gauge of a decoded ``strain`` (C,), V, is at an end of its range: (C,) bool."""
        saturated = np.zeros(len(strain), dtype=bool)
        for columns, gauges in zip(self.layout.channel, self.layout.gauges, strict=True):
            for column, gauge in zip(columns.tolist(), gauges, strict=False):
                saturated[column] = not gauge.lowest < strain[column] < gauge.highest
        return saturated

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
        name = self.phalanges[phalanx]
        gauges = {g.replace("{phalanx}", name): i for i, g in enumerate(self._names.gauges)}
        counter, status_name = (
            signal.replace("{phalanx}", name) for signal in (self._names.counter, self._names.status)
        )
        frames = []
        for message in self._messages[phalanx]:
            values: dict[str, float] = {}
            for signal in message.signals:
                if signal.name in gauges:
                    values[signal.name] = _to_raw(signal, float(strain[gauges[signal.name]]))
                elif signal.name == counter:
                    values[signal.name] = sequence % (1 << signal.length)
                else:
                    values[signal.name] = status if signal.name == status_name else 0
            data = message.encode(values, scaling=False, strict=False)
            frames.append(
                can.Message(
                    timestamp=stamp_s,
                    arbitration_id=message.frame_id,
                    is_extended_id=message.is_extended_frame,
                    is_fd=self.is_fd,
                    data=data.ljust(wire_length(message.length), b"\0"),
                )
            )
        return frames


class _Reader:
    """Reads the frames of one message."""

    def __init__(self, layout: Layout, slot: int) -> None:
        message = layout.message[slot]
        self.slot, self.length = slot, int(layout.length[slot])
        self._bytes, self._unpack = message.length, message.decode_simple
        self._gauges = layout.gauges[slot]
        self._counter, self._status = layout.counter[slot], layout.status[slot]
        self._counter_mask = (1 << int(layout.counter_bits[slot])) - 1

    def read(self, data: bytes) -> tuple[int, bool, bool, list[float]]:
        """Counter, fault, saturation, and voltages of the gauges, V."""
        raw: dict[str, Any] = self._unpack(data[: self._bytes], decode_choices=False, scaling=False)
        volts, fault, saturated = [], bool(self._status and raw[self._status] != 0), False
        for gauge in self._gauges:
            value = (raw[gauge.signal] * gauge.scale + gauge.offset) * gauge.volts
            volts.append(value)
            if not gauge.lowest < value < gauge.highest:
                saturated = saturated or value == value
                fault = fault or not math.isfinite(value)
        return raw[self._counter] & self._counter_mask if self._counter else 0, fault, saturated, volts


def _to_raw(signal: Signal, volts: float) -> float:
    raw = (volts / VOLTS[signal.unit] - signal.offset) / signal.scale
    lowest, highest = raw_range(signal)
    return raw if signal.is_float else max(lowest, min(highest, round(raw)))
