"""Driver of a hand's load cells: receive thread, decoding, assembly of cycles, and tare."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import can
import numpy as np

from tactile_localizer.io.can.assembler import Cycle, CycleAssembler
from tactile_localizer.io.can.bus import BusSettings, open_bus
from tactile_localizer.io.can.protocol import LoadCellProtocol
from tactile_localizer.io.can.reader import LONGEST_WAIT_S, CanReader
from tactile_localizer.io.can.tare import tare_offset


class LoadCellDriver(CanReader):
    """Reads load cells in a thread and delivers cycles.

    Parameters
    ----------
    protocol : layout of the frames
    bus : bus to open
    on_cycle : called in the receive thread with each cycle, after subtraction of the tare offset
    period_s : period of the samples, s; 0: estimated
    max_age_s : age from which frames are discarded, s: when the thread was late, the newest ones are used
    reader : log of :class:`~tactile_localizer.io.can.reader.CanReader`

    Attributes
    ----------
    protocol, bus, max_age_s : as given
    offset : (C,) V, subtracted from each strain vector
    assembler : assembly of the frames, with its period
    counts : totals of frames, cycles and phalanges
    read_ns : time up to which the bus was read, ns: receive time of the newest frame, or when there was none
    late_ns : greatest age of a frame when it was read, ns; its reader sets it to 0
    """

    def __init__(
        self,
        protocol: LoadCellProtocol,
        bus: BusSettings,
        on_cycle: Callable[[Cycle], None],
        *,
        period_s: float = 0.0,
        max_age_s: float = 0.2,
        **reader: Any,
    ) -> None:
        super().__init__(bus.receive_buffer, **reader)
        self.protocol = protocol
        self.offset = np.zeros(protocol.channels.size)
        self.read_ns = time.time_ns()
        self.late_ns = 0
        self.bus, self.max_age_s = bus, max_age_s
        self._on_cycle = on_cycle
        self.assembler = CycleAssembler(protocol, period_s)
        self.counts = self.assembler.counts
        self._at_rest: list[Cycle] | None = None  # cycles during a tare

    def tare(self, duration_s: float, spread_limit: float) -> np.ndarray:
        """Average the strain for ``duration_s``, and subtract it from now on; returns the offset (C,), V.

        Must not be called in the receive thread, which continues during the tare.

        Raises
        ------
        MeasurementError
            Too few valid samples were received, or the hand moved; the offset is unchanged.
        """
        at_rest: list[Cycle] = []
        self._at_rest = at_rest
        self._stop.wait(duration_s)
        self._at_rest = None
        cycles = list(at_rest)  # the receive thread may append a last one
        self.offset = tare_offset(cycles, self.protocol.phalanges, self.protocol.channels, spread_limit)
        return self.offset

    def _open_bus(self) -> can.BusABC:
        return open_bus(self.bus, self.protocol)

    def _interrupted(self) -> None:
        self.assembler.reset()

    def _deliver(self, messages: list[can.Message]) -> float:
        now_ns = self.read_ns = time.time_ns()
        if messages:
            self.read_ns = round(messages[-1].timestamp * 1e9)
            self.late_ns = max(self.late_ns, now_ns - round(messages[0].timestamp * 1e9))
            cycles = self.assembler.feed(messages, now_ns - round(self.max_age_s * 1e9))
        else:
            cycles = self.assembler.flush(now_ns)
        at_rest = self._at_rest
        for cycle in cycles:
            if at_rest is not None:
                at_rest.append(cycle)
            self._on_cycle(replace(cycle, strain=cycle.strain - self.offset))
        remaining_ns = self.assembler.remaining_ns(time.time_ns())
        return LONGEST_WAIT_S if remaining_ns is None else remaining_ns * 1e-9
