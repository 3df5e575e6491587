"""Load cells that count the frames that they send, and a subscriber to the driver."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import can
import numpy as np
from support.load_cells import cycle, number_of, protocol

HAND = protocol()


class Listener:
    """Subscriber to a driver node; waits until the node is active."""

    def __init__(self, probe: Any) -> None:
        from diagnostic_msgs.msg import DiagnosticArray

        self.probe = probe
        self.strains: list[Any] = []
        self.diagnostics = probe.listen(DiagnosticArray, "/diagnostics")
        probe.until(lambda: self.diagnostics, "the driver")

    def listen(self, hand: Sender) -> None:
        """Receive strain vectors from now on: ``hand`` sends until the first complete one arrives."""
        from rclpy.qos import QoSProfile, ReliabilityPolicy

        from tactile_localizer.msg import StrainVectors

        best_effort = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.strains = self.probe.listen(StrainVectors, "strain", best_effort)

        def is_complete() -> bool:
            hand.send(1)
            return bool(self.strains) and not any(self.strains[-1].status)

        self.probe.until(is_complete, "the driver's strain")
        self.probe.until(lambda: self.numbers()[-1] == {hand.number - 1}, "the last cycle sent")
        self.strains.clear()

    def counted(self, what: str) -> dict[str, str]:
        """Values of the newest diagnostics of ``CAN bus`` or of a phalanx."""
        (status,) = [one for one in self.diagnostics[-1].status if one.name == f"driver: {what}"]
        return {pair.key: pair.value for pair in status.values}

    def drops(self) -> int:
        """Number of lost frames reported by the driver."""
        return sum(int(self.counted(phalanx)["drops"]) for phalanx in ("index", "middle"))

    def reconnects(self, count: int) -> Callable[[], bool]:
        """Condition that the bus was reopened ``count`` times."""
        return lambda: self.counted("CAN bus")["reconnects"] == str(count)

    def numbers(self) -> list[set[int]]:
        """Numbers of the samples in each strain vector; fails on voltages that were not sent."""
        return [
            {
                number_of(p, np.array(message.strain[8 * p : 8 * p + 8]))
                for p in range(2)
                if not message.status[p] & message.MISSING
            }
            for message in self.strains
        ]


class Sender:
    """Sends numbered cycles, and counts frames sent, omitted and added."""

    def __init__(self, bus: can.BusABC, probe: Any) -> None:
        self._bus, self._probe = bus, probe
        self._rng = np.random.default_rng(0)
        self.number = 0  # of the next cycle
        self.sent = self.lost = self.garbage = 0

    def send(self, count: int, loss: float = 0.0, silent: bool = False) -> range:
        """Send cycles, the first and last of them completely; returns their numbers.

        ``loss`` is the fraction of omitted frames, and adds garbage after a tenth of the others; ``silent``
        omits the second phalanx.
        """
        numbers = range(self.number, self.number + count)
        for n in numbers:
            at_an_end = n in (numbers[0], numbers[-1])
            for i, frame in enumerate(cycle(HAND, n)):
                if (silent and i >= 2) or (self._rng.random() < loss and not at_an_end):
                    self.lost += 1
                    continue
                self._bus.send(frame)
                self.sent += 1
                if loss and self._rng.random() < 0.1:
                    data = self._rng.bytes(8)
                    self._bus.send(can.Message(arbitration_id=0x7FF, is_extended_id=False, data=data))
                    self.garbage += 1
            self._probe.executor.spin_once(timeout_sec=0.002)
        self.number += count
        return numbers

    def pause(self, cycles: int) -> None:
        """Skip cycles, as while the bus is closed."""
        self.number += cycles

    def wait(self, listener: Listener) -> None:
        """Wait until the driver has counted every frame sent."""
        expected = (str(self.sent), str(self.garbage))

        def counted() -> bool:
            reports = listener.counted("CAN bus")
            return (reports["frames_data"], reports["frames_unknown_id"]) == expected

        self._probe.until(counted, "all frames counted")
