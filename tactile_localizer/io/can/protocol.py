"""Decoding of CAN frames to volts and encoding of volts to frames, according to a DBC."""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import can
import numpy as np

from tactile_localizer.io.can.frames import ERROR, REMOTE, frame_key
from tactile_localizer.io.can.layout import (
    PhalanxMessages,
    SignalNames,
    compile_layout,
    load_dbc,
    phalanx_messages,
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


class Decoded(NamedTuple):
    """Content of a frame.

    Attributes
    ----------
    kind : what the frame is; the other attributes are valid for ``DATA`` only
    slot : index of the message, in the order of :attr:`LoadCellProtocol.messages`
    counter : rolling counter, 0 if the message has none
    fault : the load cell's status is not 0, or a voltage is not finite
    saturated : a gauge pair is at an end of its range
    voltage : voltages of the message's gauges, V
    """

    kind: FrameKind
    slot: int = -1
    counter: int = 0
    fault: bool = False
    saturated: bool = False
    voltage: Sequence[float] = ()


class LoadCellProtocol:
    """Frame format of a hand's load cells, made by :meth:`from_dbc`.

    It is stateless; :class:`~tactile_localizer.io.can.assembler.CycleAssembler` assigns frames to cycles.

    Attributes
    ----------
    phalanges : names, in the order of the strain vector
    messages : of all phalanges
    channels : channels of the strain vector by phalanx
    is_fd : whether any message needs CAN FD
    """

    def __init__(self, phalanges: Sequence[str], messages: PhalanxMessages, names: SignalNames) -> None:
        self.phalanges = tuple(phalanges)
        self.messages, self.channels = compile_layout(self.phalanges, messages, names)
        self.is_fd = any(message.length > 8 or message.definition.is_fd for message in self.messages)
        self._slots = {message.key: slot for slot, message in enumerate(self.messages)}

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
        definitions = phalanx_messages(load_dbc(path), phalanges, messages or {})
        return cls(phalanges, definitions, names or SignalNames())

    @property
    def message_names(self) -> tuple[str, ...]:
        """Name of each message."""
        return tuple(message.definition.name for message in self.messages)

    @property
    def filters(self) -> list[can.typechecking.CanFilter]:
        """Filters for the kernel or the adapter that pass exactly the messages in use."""
        return [
            {
                "can_id": definition.frame_id,
                "can_mask": 0x1FFFFFFF if definition.is_extended_frame else 0x7FF,
                "extended": bool(definition.is_extended_frame),
            }
            for definition in (message.definition for message in self.messages)
        ]

    def decode(self, frame: can.Message) -> Decoded:
        """Decode a frame; never raises, whatever its content."""
        key = frame_key(frame)
        slot = self._slots.get(key)
        if slot is None:
            flag = FrameKind.REMOTE if key & REMOTE else FrameKind.UNKNOWN_ID
            return Decoded(FrameKind.ERROR if key & ERROR else flag)
        message = self.messages[slot]
        if len(frame.data) != message.length:
            return Decoded(FrameKind.WRONG_LENGTH)
        raw: dict[str, Any] = message.definition.decode_simple(
            bytes(frame.data[: message.definition.length]), decode_choices=False, scaling=False
        )
        fault, saturated, volts = bool(message.status and raw[message.status.name] != 0), False, []
        for gauge in message.gauges:
            value = (raw[gauge.signal.name] * gauge.scale + gauge.offset) * gauge.volts
            volts.append(value)
            if not gauge.lowest < value < gauge.highest:
                saturated = saturated or value == value
                fault = fault or not math.isfinite(value)
        counter = raw[message.counter.name] & ((1 << message.counter_bits) - 1) if message.counter else 0
        return Decoded(FrameKind.DATA, slot, counter, fault, saturated, volts)

    def saturated(self, strain: np.ndarray) -> np.ndarray:
        """Whether each gauge of a decoded ``strain`` (C,), V, is at an end of its range: (C,) bool."""
        saturated = np.zeros(len(strain), dtype=bool)
        for gauge in (gauge for message in self.messages for gauge in message.gauges):
            saturated[gauge.column] = not gauge.lowest < strain[gauge.column] < gauge.highest
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
        frames = []
        first = self.channels.slices[phalanx].start
        for message in self.messages:
            if message.phalanx != phalanx:
                continue
            values: dict[str, float] = dict.fromkeys(
                (signal.name for signal in message.definition.signals), 0
            )
            for gauge in message.gauges:
                values[gauge.signal.name] = gauge.raw(float(strain[gauge.column - first]))
            if message.counter:
                values[message.counter.name] = sequence % (1 << message.counter.length)
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
