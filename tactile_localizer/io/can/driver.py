"""Driver of a hand's load cells: receive thread, decoding, assembly of cycles, and tare."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import can
import numpy as np

from tactile_localizer.io.can.assembler import Counts, Cycle, CycleAssembler
from tactile_localizer.io.can.bus import BusSettings, open_bus
from tactile_localizer.io.can.protocol import LoadCellProtocol
from tactile_localizer.io.can.reader import LONGEST_WAIT_S, BusStatus, CanReader
from tactile_localizer.io.can.tare import TareAverage


@dataclass(frozen=True)
class DriverSettings:
    """Settings of the load cell driver.

    Parameters
    ----------
    bus : bus to open
    period_s : period of the samples, s; 0: estimated
    wait_for_interface : whether to wait for an interface that is absent at the start
    backoff_s, backoff_limit_s : see :class:`~tactile_localizer.io.can.reader.CanReader`
    """

    bus: BusSettings
    period_s: float = 0.0
    backoff_s: float = 0.1
    backoff_limit_s: float = 5.0
    wait_for_interface: bool = False


class LoadCellDriver:
    """Reads load cells and delivers cycles.

    Parameters
    ----------
    protocol : layout of the frames
    settings : bus and timeouts
    on_cycle : called in the receive thread with each cycle, after subtraction of the tare offset
    log : called with a line when the bus fails
    note : called with a line when frames are received, at the start and after a failure
    """

    def __init__(
        self,
        protocol: LoadCellProtocol,
        settings: DriverSettings,
        on_cycle: Callable[[Cycle], None],
        log: Callable[[str], None],
        note: Callable[[str], None] = lambda line: None,
    ) -> None:
        self.protocol = protocol
        self.offset = np.zeros(protocol.channels.size)  # V, subtracted from each strain vector
        self.latest: Cycle | None = None  # before subtraction of the offset
        self._on_cycle = on_cycle
        self._assembler = CycleAssembler(protocol, settings.period_s)
        self._average: TareAverage | None = None
        self._reader = CanReader(
            lambda: open_bus(settings.bus, protocol),
            self._deliver,
            batch=len(protocol.messages),
            backoff_s=settings.backoff_s,
            backoff_limit_s=settings.backoff_limit_s,
            opened=self._assembler.reset,
            wait=settings.wait_for_interface,
            log=log,
            note=note,
        )

    @property
    def counts(self) -> Counts:
        """Totals of frames, cycles and phalanges."""
        return self._assembler.counts

    @property
    def period_ns(self) -> int:
        """Period of the samples, ns; 0 before the first estimate."""
        return self._assembler.period_ns

    @property
    def status(self) -> BusStatus:
        """State of the bus."""
        return self._reader.status

    def start(self) -> None:
        """Open the bus and start the receive thread.

        Raises
        ------
        CanError
            The bus cannot be opened.
        """
        self._reader.start()

    def stop(self) -> bool:
        """Stop the receive thread and close the bus; returns whether that succeeded in time."""
        return self._reader.stop()

    def reconnect(self) -> None:
        """Close and reopen the bus."""
        self._reader.reconnect()

    def tare(self, duration_s: float, spread_limit: float, cancelled: Callable[[], bool]) -> np.ndarray:
        """Average the strain for ``duration_s``, and subtract it from now on; returns the offset (C,), V.

        Must not be called in the receive thread, which continues during the tare.

        Raises
        ------
        MeasurementError
            Too few valid samples were received, or the hand moved; the offset is unchanged.
        """
        average = TareAverage(self.protocol.phalanges, spread_limit, self.protocol.channels)
        self._average = average
        end_s = time.monotonic() + duration_s
        pause = threading.Event()
        while (left_s := end_s - time.monotonic()) > 0 and not cancelled():
            pause.wait(min(left_s, LONGEST_WAIT_S))
        self._average = None
        self.offset = average.offset()
        return self.offset

    def _deliver(self, messages: list[can.Message]) -> float:
        cycles = self._assembler.feed(messages) if messages else self._assembler.flush(time.time_ns())
        average = self._average
        for cycle in cycles:
            self.latest = cycle
            if average is not None:
                average.add(cycle.strain, cycle.status)
            self._on_cycle(replace(cycle, strain=cycle.strain - self.offset))
        remaining_ns = self._assembler.remaining_ns(time.time_ns())
        return LONGEST_WAIT_S if remaining_ns is None else remaining_ns * 1e-9
