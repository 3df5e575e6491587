"""Driver of a hand's load cells: receive thread, decoding, assembly of cycles, and tare."""

from __future__ import annotations

import threading
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
    offset : (C,) V, subtracted from each strain vector
    latest : newest cycle before subtraction of the offset; ``None`` before the first
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
        self.protocol = protocol
        self.offset = np.zeros(protocol.channels.size)
        self.latest: Cycle | None = None
        self.read_ns = time.time_ns()
        self.late_ns = 0
        self._max_age_ns = round(max_age_s * 1e9)
        self._on_cycle = on_cycle
        self._assembler = CycleAssembler(protocol, period_s)
        self.counts = self._assembler.counts
        self._at_rest: list[Cycle] | None = None  # cycles during a tare
        super().__init__(
            lambda: open_bus(bus, protocol),
            self._assemble,
            batch=len(protocol.messages),
            receive_buffer=bus.receive_buffer,
            interrupted=self._assembler.reset,
            **reader,
        )

    @property
    def period_ns(self) -> int:
        """Period of the samples, ns; 0 before the first estimate."""
        return self._assembler.period_ns

    def tare(self, duration_s: float, spread_limit: float, cancelled: Callable[[], bool]) -> np.ndarray:
        """Average the strain for ``duration_s``, and subtract it from now on; returns the offset (C,), V.

        Must not be called in the receive thread, which continues during the tare.

        Raises
        ------
        MeasurementError
            Too few valid samples were received, or the hand moved; the offset is unchanged.
        """
        at_rest: list[Cycle] = []
        self._at_rest = at_rest
        end_s = time.monotonic() + duration_s
        pause = threading.Event()
        while (left_s := end_s - time.monotonic()) > 0 and not cancelled():
            pause.wait(min(left_s, LONGEST_WAIT_S))
        self._at_rest = None
        cycles = list(at_rest)  # the receive thread may append a last one
        self.offset = tare_offset(cycles, self.protocol.phalanges, self.protocol.channels, spread_limit)
        return self.offset

    def _assemble(self, messages: list[can.Message]) -> float:
        now_ns = self.read_ns = time.time_ns()
        if messages:
            self.read_ns = round(messages[-1].timestamp * 1e9)
            self.late_ns = max(self.late_ns, now_ns - round(messages[0].timestamp * 1e9))
            cycles = self._assembler.feed(messages, now_ns - self._max_age_ns)
        else:
            cycles = self._assembler.flush(now_ns)
        at_rest = self._at_rest
        for cycle in cycles:
            self.latest = cycle
            if at_rest is not None:
                at_rest.append(cycle)
            self._on_cycle(replace(cycle, strain=cycle.strain - self.offset))
        remaining_ns = self._assembler.remaining_ns(time.time_ns())
        return LONGEST_WAIT_S if remaining_ns is None else remaining_ns * 1e-9
