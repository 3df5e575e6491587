"""Diagnostics of the driver node: the CAN bus, and each phalanx."""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus

from tactile_localizer.io.can.clock import SMALLEST_JUMP_S
from tactile_localizer.io.can.driver import OPEN, LoadCellDriver
from tactile_localizer.io.can.error_frames import BUS_OFF, ERROR_ACTIVE, ERROR_PASSIVE
from tactile_localizer.io.can.findings import describe_counter, describe_discarded
from tactile_localizer.io.can.protocol import FrameKind
from tactile_localizer.ros.diagnostics.status import DiagnosticsPublisher, Increments


class DriverDiagnostics:
    """Makes the statuses of a driver; rates and losses refer to the time since the previous call.

    A silent bus is OK, because the hand can be switched off. A phalanx is not OK if it stopped sending, or
    never sent although others do.

    Parameters
    ----------
    driver : driver to describe
    publisher : publisher of the statuses
    stale_timeout_s : time without frames after which a phalanx is stale, s
    strain_publishers : returns the number of publishers of the strain topic, including this driver
    """

    def __init__(
        self,
        driver: LoadCellDriver,
        publisher: DiagnosticsPublisher,
        stale_timeout_s: float,
        strain_publishers: Callable[[], int] = lambda: 1,
    ) -> None:
        self._driver = driver
        self._publisher = publisher
        self._stale_timeout_s = stale_timeout_s
        self._strain_publishers = strain_publishers
        self._increments = Increments()

    def statuses(self) -> list[DiagnosticStatus]:
        """Status of the bus, followed by one status per phalanx."""
        status, counts = self._driver.status, self._driver.counts
        frames = dict(zip(FrameKind, counts.frames, strict=True))
        phalanges = dict(zip(self._driver.protocol.phalanges, map(asdict, counts.phalanges), strict=True))
        totals: dict[Any, int] = {**frames, **dict(status.errors)}
        totals |= {"cycles": counts.cycles, "drops": status.queue_drops}
        totals["clock jumps"] = status.clock.jumps if status.clock else 0
        for name, own in phalanges.items():
            totals |= {(name, what): count for what, count in own.items() if isinstance(count, int)}
        new = self._increments.since(totals)
        stray, misfits, suspects = self._explain()
        return [
            self._bus_status(frames, new, stray, "; ".join(misfits.values())),
            *(
                self._phalanx_status(name, own, new, misfits.get(p, ""), suspects.get(p, ""))
                for p, (name, own) in enumerate(phalanges.items())
            ),
        ]

    def _explain(self) -> tuple[str, dict[int, str], dict[int, str]]:
        """A foreign identifier, and unused frames and doubtful values by phalanx, since the previous call."""
        protocol, counts = self._driver.protocol, self._driver.counts
        frames, data = counts.misfits.copy(), counts.suspects.copy()
        counts.misfits.clear()
        counts.suspects.clear()
        stray = frames.pop(-1, None)
        misfits = {
            protocol.messages[slot].phalanx: protocol.misfit(one, slot) for slot, one in frames.items()
        }
        suspects = {phalanx: protocol.explain(phalanx, one) for phalanx, one in data.items()}
        return f", the last 0x{stray.arbitration_id:X}" if stray else "", misfits, suspects

    def _bus_status(
        self, frames: Mapping[FrameKind, int], new: Mapping[Any, int], stray: str, misfits: str
    ) -> DiagnosticStatus:
        status, elapsed_s = self._driver.status, self._increments.elapsed_s
        received = sum(new[kind] for kind in FrameKind)
        late_s = 1e-9 * max(self._driver.late_ns, time.time_ns() - self._driver.read_ns)
        self._driver.late_ns = 0  # the greatest age since this status
        at = f" at {time.strftime('%F %T', time.gmtime(status.error_s))} UTC" if status.error else ""
        values = {
            "state": status.state,
            "controller": status.controller,
            "last_error": status.error + at,
            "reconnects": status.reconnects,
            "frames_per_s": f"{received / elapsed_s:.1f}",
            **{f"frames_{kind.name.lower()}": count for kind, count in frames.items()},
            "frames_unreadable": status.unreadable,
            "bus_errors": ", ".join(f"{count} {kind}" for kind, count in dict(status.errors).items()),
            "cycles_per_s": f"{new['cycles'] / elapsed_s:.1f}",
            "queue_drops": status.queue_drops,
            "clock_offset_s": f"{status.clock.offset_s:.3f}" if status.clock else "",
        }
        level = self._bus_level(new, received, late_s, stray, misfits)
        return self._publisher.status("CAN bus", *level, values)

    def _bus_level(
        self, new: Mapping[Any, int], received: int, late_s: float, stray: str, misfits: str
    ) -> tuple[bytes, str]:
        """Level and message of the bus: an error, or all warnings since the previous status."""
        status, publishers = self._driver.status, self._strain_publishers()
        clock = status.clock
        if status.state != OPEN:
            return DiagnosticStatus.ERROR, f"{status.state}: {status.error}"
        if publishers > 1:
            return DiagnosticStatus.ERROR, f"expected one publisher of strain, found {publishers}"
        if status.controller in (BUS_OFF, ERROR_PASSIVE):
            return DiagnosticStatus.ERROR, f"{status.controller}: wrong bit rate, wiring or termination"
        discarded = describe_discarded({kind: new[kind] for kind in FrameKind})
        errors = ", ".join(f"{new[kind]} {kind}" for kind in dict(status.errors) if new.get(kind))
        unknown = new[FrameKind.UNKNOWN_ID] + new[FrameKind.UNKNOWN_PAGE]
        foreign = 0 if new[FrameKind.DATA] else status.foreign + unknown
        place = f"on {self._driver.bus.channel}"
        named = f": {misfits}" if misfits else ""
        warnings = {
            f"{new['drops']} frames dropped, receive queue full": new["drops"],
            f"read {late_s:.1f} s late: {new[FrameKind.LATE]} frames discarded": late_s
            > self._driver.max_age_s,
            discarded + named: discarded,
            f"bus errors: {errors}": errors,
            status.controller: status.controller != ERROR_ACTIVE,
            f"idle: {foreign} frames {place}, none with an identifier of the DBC{stray}{named}": foreign,
            f"the sender's clock jumped by {clock.jump_s if clock else 0.0:+.3f} s": new["clock jumps"],
        }
        if any(warnings.values()):
            return DiagnosticStatus.WARN, "; ".join(text for text, holds in warnings.items() if holds)
        text = "open" if received else "open, idle"
        if clock is not None and abs(clock.offset_s) > SMALLEST_JUMP_S:
            side = "behind" if clock.offset_s > 0 else "ahead"
            text += f"; the sender's clock is {abs(clock.offset_s):.1f} s {side}"
        return DiagnosticStatus.OK, text

    def _phalanx_status(
        self, name: str, counts: dict[str, Any], new: Mapping[Any, int], misfit: str, suspect: str
    ) -> DiagnosticStatus:
        new_of_phalanx = {what: new[name, what] for what in counts if (name, what) in new}
        last_ns = counts.pop("last_ns")
        # Not until now: frames that wait in the queue are the reader's fault, not the phalanx's.
        age_s = max(0.0, (self._driver.read_ns - last_ns) * 1e-9) if last_ns else None
        rate_hz = new_of_phalanx["samples"] / self._increments.elapsed_s
        values = {
            "rate_hz": f"{rate_hz:.1f}",
            "age_s": "" if age_s is None else f"{age_s:.3f}",
            **counts,
            "cycles_per_sample": f"{counts['cycles_per_sample']:.3g}",
        }
        if not new_of_phalanx["samples"] and (age_s or 0.0) < self._stale_timeout_s:
            reason = misfit or (age_s is not None and self._absent(name))
            if reason:
                return self._publisher.status(name, DiagnosticStatus.ERROR, reason, values)
        return self._publisher.status(name, *self._level(new_of_phalanx, age_s, suspect, counts), values)

    def _absent(self, name: str) -> str:
        """A message of the phalanx that does not come although others of it do, in words."""
        protocol, has_received = self._driver.protocol, self._driver.assembler.has_received
        own = [slot for slot, one in enumerate(protocol.messages) if protocol.phalanges[one.phalanx] == name]
        absent = [protocol.messages[slot].name for slot in own if not has_received(slot)]
        return f"{', '.join(absent)} not received" if absent else ""

    def _level(
        self, new: Mapping[str, int], age_s: float | None, suspect: str, counts: Mapping[str, Any]
    ) -> tuple[bytes, str]:
        """Level and message of a phalanx: the most severe problem since the previous status."""
        if age_s is None and self._driver.counts.cycles:
            return DiagnosticStatus.ERROR, "silent: no frames received, while other phalanges send"
        if age_s is None:
            return DiagnosticStatus.OK, "idle"
        if age_s > self._stale_timeout_s:
            return DiagnosticStatus.ERROR, f"stale: no frames for {age_s:.1f} s"
        if new["faults"]:
            return DiagnosticStatus.ERROR, f"fault reported by the load cell: {suspect}"
        received = new["samples"] + new["missing"]
        counter = describe_counter(counts["counter"], new["jumps"], received)
        cycles_per_sample = counts["cycles_per_sample"]
        is_slow = cycles_per_sample > 1.0
        # Samples, if none is missing; as long as its rate is not known, a load cell may be slow.
        expected = math.floor(received / (cycles_per_sample or math.inf)) - is_slow
        warnings = {
            f"saturated: {suspect}": new["saturated"],
            counter: counter,
            f"{new['drops']} frames lost": new["drops"],
            f"missing in {new['missing']} of {received} cycles": new["samples"] < expected,
        }
        for text, holds in warnings.items():
            if holds:
                return DiagnosticStatus.WARN, text
        return DiagnosticStatus.OK, f"OK, in one of {cycles_per_sample:.3g} cycles" if is_slow else "OK"
