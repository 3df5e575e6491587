"""What the driver tells about itself once a second: the bus, and each phalanx."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from tactile_localizer.io.can.cycle import PhalanxCounts
from tactile_localizer.io.can.driver import LoadCellDriver
from tactile_localizer.io.can.error_frames import ERROR_KINDS
from tactile_localizer.io.can.protocol import FrameKind
from tactile_localizer.io.can.reader import OPEN

_MIN_INTERLEAVED = 10
_INTERLEAVED_SHARE = 0.2
"""Frames that do not fit the counter, of the cycles since the last diagnostics, that indicate two senders."""

_SUSPECT = (FrameKind.ERROR, FrameKind.WRONG_LENGTH, FrameKind.OUT_OF_ORDER, FrameKind.DUPLICATE)


class DriverDiagnostics:
    """Makes the diagnostics of a driver; rates are over the time since the last call.

    A bus on which nothing is sent is well: a hand may be switched off. A phalanx that was heard and is no
    more, or is silent while others send, is not.

    Parameters
    ----------
    driver : whose totals are told
    name : of the node, before each status's own name
    bus : what the bus is called
    stale_timeout_s : silence after which a phalanx is stale, s
    publishers : number of publishers of the strain topic, this driver included
    """

    def __init__(
        self,
        driver: LoadCellDriver,
        name: str,
        bus: str,
        stale_timeout_s: float,
        publishers: Callable[[], int] = lambda: 1,
    ) -> None:
        self._driver = driver
        self._name = name
        self._bus = bus
        self._stale_timeout_s = stale_timeout_s
        self._publishers = publishers
        self._previous_errors = driver.status.errors.copy()
        self._previous = copy.deepcopy(driver.counts)
        self._previous_drops = driver.status.queue_drops
        self._previous_s = time.monotonic()

    def statuses(self) -> list[DiagnosticStatus]:
        """One status of the bus, then one of each phalanx."""
        now_s = time.monotonic()
        elapsed_s = max(now_s - self._previous_s, 1e-3)
        counts, previous = copy.deepcopy(self._driver.counts), self._previous
        drops = self._driver.status.queue_drops
        new_frames = [a - b for a, b in zip(counts.frames, previous.frames, strict=True)]
        statuses = [self._of_bus(counts.frames, new_frames, drops - self._previous_drops, elapsed_s)]
        heard = counts.cycles > 0
        for i, (own, before) in enumerate(zip(counts.phalanges, previous.phalanges, strict=True)):
            statuses.append(self._of_phalanx(i, own, before, heard, elapsed_s))
        self._previous, self._previous_drops, self._previous_s = counts, drops, now_s
        return statuses

    def _of_bus(
        self, frames: list[int], new_frames: list[int], new_drops: int, elapsed_s: float
    ) -> DiagnosticStatus:
        status = self._driver.status
        new = {kind: new_frames[kind] for kind in _SUSPECT if new_frames[kind]}
        errors = status.errors.copy()
        new_errors, self._previous_errors = errors - self._previous_errors, errors
        publishers = self._publishers()
        if status.state != OPEN:
            level, message = DiagnosticStatus.ERROR, f"{status.state}: {status.error}"
        elif publishers > 1:
            level = DiagnosticStatus.ERROR
            message = f"{publishers} publishers of strain: expected this driver alone"
        elif new_drops:
            level, message = DiagnosticStatus.WARN, f"{new_drops} frames dropped: the receive queue was full"
        elif new:
            told = ", ".join(f"{count} {_words(kind)}" for kind, count in new.items())
            what = ", ".join(f"{count} {kind}" for kind, count in new_errors.items())
            level = DiagnosticStatus.WARN
            message = f"frames not used: {told}" + (f"; bus errors: {what}" if what else "")
        else:
            level, message = DiagnosticStatus.OK, "open" if sum(new_frames) else "open, idle"
        values = {
            "bus": self._bus,
            "state": status.state,
            "last_error": status.error,
            "reconnects": status.reconnects,
            "frames_per_s": f"{sum(new_frames) / elapsed_s:.1f}",
            **{f"frames_{kind.name.lower()}": frames[kind] for kind in FrameKind},
            "unreadable": status.unreadable,
            **{f"errors_{kind.replace(' ', '_')}": errors[kind] for kind in ERROR_KINDS},
            "strain_publishers": publishers,
            "cycles": self._driver.counts.cycles,
            "cycles_incomplete": self._driver.counts.incomplete,
            "queue_bytes": status.queue_used,
            "queue_limit_bytes": status.queue_limit,
            "queue_drops": status.queue_drops,
        }
        return self._status("CAN bus", level, message, values)

    def _of_phalanx(
        self, i: int, own: PhalanxCounts, before: PhalanxCounts, heard: bool, elapsed_s: float
    ) -> DiagnosticStatus:
        latest = self._driver.latest
        gauges = np.zeros(0, dtype=np.intp)
        if latest is not None:
            saturated = self._driver.protocol.saturated(latest.strain)
            gauges = np.flatnonzero(saturated[self._driver.protocol.channels.slices[i]]) + 1
        age_s = max(0.0, time.time() - own.last_ns * 1e-9) if own.last_ns else None
        lost = own.drops - before.drops
        received = own.samples + own.missing - before.samples - before.missing
        level, message = DiagnosticStatus.OK, "well"
        if age_s is None:
            silent = "silent: nothing received yet, while other phalanges send"
            level, message = (DiagnosticStatus.ERROR, silent) if heard else (DiagnosticStatus.OK, "idle")
        elif age_s > self._stale_timeout_s:
            level, message = DiagnosticStatus.ERROR, f"stale: nothing received for {age_s:.1f} s"
        elif own.interleaved - before.interleaved > max(_MIN_INTERLEAVED, _INTERLEAVED_SHARE * received):
            count = own.interleaved - before.interleaved
            level = DiagnosticStatus.ERROR
            message = f"two senders with its identifiers: {count} frames do not fit the counter"
        elif own.faults > before.faults:
            level, message = DiagnosticStatus.ERROR, "the load cell reports a fault"
        elif own.saturated > before.saturated:
            level, message = DiagnosticStatus.WARN, "saturated"
        elif lost:
            level, message = DiagnosticStatus.WARN, f"{lost} frames lost"
        elif own.unaligned > before.unaligned:
            count = own.unaligned - before.unaligned
            level, message = DiagnosticStatus.WARN, f"{count} samples not used: their cycle is not certain"
        values = {
            "rate_hz": f"{(own.samples - before.samples) / elapsed_s:.1f}",
            "age_s": "" if age_s is None else f"{age_s:.3f}",
            "samples": own.samples,
            "missing": own.missing,
            "gaps": own.gaps,
            "drops": own.drops,
            "unaligned": own.unaligned,
            "interleaved": own.interleaved,
            "saturated_samples": own.saturated,
            "saturated_gauges": " ".join(map(str, gauges)),
            "faults": own.faults,
        }
        return self._status(self._driver.protocol.phalanges[i], level, message, values)

    def _status(self, what: str, level: bytes, message: str, values: Mapping[str, Any]) -> DiagnosticStatus:
        return DiagnosticStatus(
            name=f"{self._name}: {what}",
            hardware_id=self._bus,
            level=level,
            message=message,
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )


def _words(kind: FrameKind) -> str:
    return kind.name.lower().replace("_", " ")
