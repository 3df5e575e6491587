"""Frames that load cells need: those that start, synchronize or poll, and stop them."""

import io
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import can
from can import CanutilsLogReader
from can.broadcastmanager import ThreadBasedCyclicSendTask

from tactile_localizer.errors import CanError

_FRAME = re.compile(
    r"([0-7][0-9A-F]{2}|[01][0-9A-F]{7})#(R[0-8]?|([0-9A-F]{2}){0,8}|#[0-3]([0-9A-F]{2}){0,64})",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class Commands:
    """Frames to send; none by default.

    Parameters
    ----------
    start : sent when the bus opens, and while load cells are silent
    stop : sent before the bus is closed on purpose
    sync : each sent every ``sync_period_s``, s
    """

    start: Sequence[can.Message] = ()
    stop: Sequence[can.Message] = ()
    sync: Sequence[can.Message] = ()
    sync_period_s: float = 0.01

    def begin(self, bus: can.BusABC) -> None:
        """Send the start frames, and begin to send others periodically."""
        bus.stop_all_periodic_tasks()
        for frame in self.start:
            bus.send(frame)
        for frame in self.sync:
            task = bus.send_periodic(frame, self.sync_period_s)
            if isinstance(task, ThreadBasedCyclicSendTask):
                task.on_error = lambda error: True  # continue: the bus can recover

    def end(self, bus: can.BusABC) -> None:
        """End what was begun, and send the stop frames."""
        bus.stop_all_periodic_tasks()
        for frame in self.stop:
            bus.send(frame)


def parse_frames(texts: Iterable[str]) -> list[can.Message]:
    """Frames as candump prints them: ``064#0B``, ``18FF1021#01``, ``064#R`` (remote), ``064##10B`` (CAN FD).

    Raises
    ------
    CanError
        A text is no such frame.
    """
    frames: list[can.Message] = []
    for text in texts:
        if not _FRAME.fullmatch(text):
            raise CanError(f"frame {text!r}: expected IDENTIFIER#DATA as candump prints it, such as 064#0B")
        frames += CanutilsLogReader(io.StringIO(f"(0) can {text}"))
    return frames
