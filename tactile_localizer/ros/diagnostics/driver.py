"""Diagnostics of the driver node: the CAN bus, and each phalanx."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus

from tactile_localizer.io.can.assembler import PhalanxCounts
from tactile_localizer.io.can.driver import LoadCellDriver
from tactile_localizer.io.can.error_frames import ERROR_KINDS
from tactile_localizer.io.can.protocol import FrameKind
from tactile_localizer.io.can.reader import OPEN
from tactile_localizer.ros.diagnostics.status import DiagnosticsPublisher

_MIN_JUMPS = 10
_JUMPS_FRACTION = 0.2
"""Fraction of samples before which the counter jumps, since the last status, that is reported."""

_SUSPECT = (FrameKind.ERROR, FrameKind.WRONG_LENGTH, FrameKind.OUT_OF_ORDER, FrameKind.DUPLICATE)


class DriverDiagnostics:
    """Makes the statuses of a driver; rates and losses refer to the time since the previous call.

    A silent bus is OK, because the hand can be switched off. A phalanx is not OK if it stopped sending, or
    never sent although others do.

    Parameters
    ----------
    driver : driver to describe
    publisher : publisher of the statuses
    bus : name of the bus
    stale_timeout_s : time without frames after which a phalanx is stale, s
    strain_publishers : returns the number of publishers of the strain topic, including this driver
    """

    def __init__(
        self,
        driver: LoadCellDriver,
        publisher: DiagnosticsPublisher,
        bus: str,
        stale_timeout_s: float,
        strain_publishers: Callable[[], int] = lambda: 1,
    ) -> None:
        self._driver = driver
        self._publisher = publisher
        self._bus = bus
        self._stale_timeout_s = stale_timeout_s
        self._strain_publishers = strain_publishers
        self._previous_errors = driver.status.errors.copy()
        self._previous = copy.deepcopy(driver.counts)
        self._previous_drops = driver.status.queue_drops
        self._previous_s = time.monotonic()

    def statuses(self) -> list[DiagnosticStatus]:
        """Status of the bus, followed by one status per phalanx."""
        now_s = time.monotonic()
        elapsed_s = max(now_s - self._previous_s, 1e-3)
        counts, previous = copy.deepcopy(self._driver.counts), self._previous
        drops = self._driver.status.queue_drops
        new_frames = [a - b for a, b in zip(counts.frames, previous.frames, strict=True)]
        self._driver.counts.skew_ns = 0  # the largest since this status
        phalanges = list(zip(counts.phalanges, previous.phalanges, strict=True))
        missing = [
            name
            for name, (now, before) in zip(self._driver.protocol.phalanges, phalanges, strict=True)
            if now.missing > before.missing
        ]
        new_drops, self._previous_drops = drops - self._previous_drops, drops
        values = {
            "cycles": counts.cycles,
            "cycles_incomplete": counts.incomplete,
            "cycles_per_s": f"{(counts.cycles - previous.cycles) / elapsed_s:.1f}",
            "period_ms": f"{self._driver.period_ns * 1e-6:.2f}",
            "max_skew_ms": f"{counts.skew_ns * 1e-6:.2f}",
            "missing_phalanges": " ".join(missing),
        }
        statuses = [self._bus_status(counts.frames, new_frames, new_drops, elapsed_s, values)]
        for i, (now, before) in enumerate(phalanges):
            statuses.append(self._phalanx_status(i, now, before, counts.cycles > 0, elapsed_s))
        self._previous, self._previous_s = counts, now_s
        return statuses

    def _bus_status(
        self,
        frames: list[int],
        new_frames: list[int],
        new_drops: int,
        elapsed_s: float,
        cycle_values: dict[str, Any],
    ) -> DiagnosticStatus:
        status = self._driver.status
        new = {kind: new_frames[kind] for kind in _SUSPECT if new_frames[kind]}
        errors = status.errors.copy()
        new_errors, self._previous_errors = errors - self._previous_errors, errors
        publishers = self._strain_publishers()
        if status.state != OPEN:
            level, message = DiagnosticStatus.ERROR, f"{status.state}: {status.error}"
        elif publishers > 1:
            level = DiagnosticStatus.ERROR
            message = f"expected one publisher of strain, found {publishers}"
        elif new_drops:
            level, message = DiagnosticStatus.WARN, f"{new_drops} frames dropped, receive queue full"
        elif new:
            discarded = ", ".join(f"{count} {_words(kind)}" for kind, count in new.items())
            bus_errors = ", ".join(f"{count} {kind}" for kind, count in new_errors.items())
            level = DiagnosticStatus.WARN
            message = f"discarded frames: {discarded}" + (f"; bus errors: {bus_errors}" if bus_errors else "")
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
            **cycle_values,
            "queue_bytes": status.queue_used,
            "queue_limit_bytes": status.queue_limit,
            "queue_drops": status.queue_drops,
        }
        return self._publisher.status("CAN bus", level, message, values)

    def _phalanx_status(
        self, i: int, now: PhalanxCounts, before: PhalanxCounts, is_receiving: bool, elapsed_s: float
    ) -> DiagnosticStatus:
        protocol, latest = self._driver.protocol, self._driver.latest
        saturated: Sequence[int] = ()
        if latest is not None:
            own = protocol.saturated(latest.strain)[protocol.channels.slices[i]]
            saturated = (np.flatnonzero(own) + 1).tolist()
        age_s = max(0.0, time.time() - now.last_ns * 1e-9) if now.last_ns else None
        values = {
            "rate_hz": f"{(now.samples - before.samples) / elapsed_s:.1f}",
            "age_s": "" if age_s is None else f"{age_s:.3f}",
            "samples": now.samples,
            "missing": now.missing,
            "gaps": now.gaps,
            "drops": now.drops,
            "jumps": now.jumps,
            "restarts": now.restarts,
            "saturated_samples": now.saturated,
            "saturated_gauges": " ".join(map(str, saturated)),
            "faults": now.faults,
        }
        level, message = self._phalanx_level(now, before, age_s, is_receiving)
        return self._publisher.status(protocol.phalanges[i], level, message, values)

    def _phalanx_level(
        self, now: PhalanxCounts, before: PhalanxCounts, age_s: float | None, is_receiving: bool
    ) -> tuple[bytes, str]:
        """Level and message of a phalanx: the most severe problem since the previous status."""
        if age_s is None and is_receiving:
            return DiagnosticStatus.ERROR, "silent: no frames received, while other phalanges send"
        if age_s is None:
            return DiagnosticStatus.OK, "idle"
        if age_s > self._stale_timeout_s:
            return DiagnosticStatus.ERROR, f"stale: no frames for {age_s:.1f} s"
        if now.faults > before.faults:
            return DiagnosticStatus.ERROR, "fault reported by the load cell"
        if now.saturated > before.saturated:
            return DiagnosticStatus.WARN, "saturated"
        return _counter_level(now, before)


def _counter_level(now: PhalanxCounts, before: PhalanxCounts) -> tuple[bytes, str]:
    received = now.samples + now.missing - before.samples - before.missing
    jumps, lost = now.jumps - before.jumps, now.drops - before.drops
    if now.restarts > before.restarts:
        text = "the counter restarted: the load cell restarted, or another one has its identifiers"
    elif jumps > max(_MIN_JUMPS, _JUMPS_FRACTION * received):
        text = f"the counter jumped {jumps} times: losses, or two load cells with its identifiers"
    elif lost:
        text = f"{lost} frames lost"
    elif now.missing > before.missing:
        text = f"missing in {now.missing - before.missing} of {received} cycles"
    else:
        return DiagnosticStatus.OK, "OK"
    return DiagnosticStatus.WARN, text


def _words(kind: FrameKind) -> str:
    return kind.name.lower().replace("_", " ")
