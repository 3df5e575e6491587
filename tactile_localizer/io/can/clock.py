"""Clock of a sender that stamps frames: a gateway, or an adapter with a clock of its own."""

LONGEST_WAKEUP_S = 0.0005
"""Longest time from the receipt of a frame to the return of a read that waited for it, s."""

SMALLEST_JUMP_S = 0.1
"""Smallest change of the offset between two frames that is a jump, not drift or jitter, s."""


class SenderClock:
    """Converts stamps of a sender's clock to the system time of this machine.

    The offset is the smallest receive delay that agrees with what is known of the newest frames: a frame was
    received after the bus was last found empty, and before it was read. A delay is therefore no lateness
    unless the frame can have waited, and clocks that are wrong, drift or jump are followed.

    Attributes
    ----------
    offset_s : time by which the clock is behind this machine, s; 0 before the first frame
    jump_s : last jump of the clock, s; 0 before the first
    jumps : number of jumps
    """

    def __init__(self) -> None:
        self.offset_s, self.jump_s, self.jumps = 0.0, 0.0, 0
        self._is_known = False

    def receipt_s(self, stamp_s: float, earliest_s: float, read_s: float) -> float:
        """Receive time of a frame, s, which was received between ``earliest_s`` and ``read_s``."""
        received_s = min(max(stamp_s + self.offset_s, earliest_s), read_s)
        change_s = received_s - stamp_s - self.offset_s
        if self._is_known and abs(change_s) > SMALLEST_JUMP_S:
            self.jump_s, self.jumps = -change_s, self.jumps + 1
        self.offset_s += change_s
        self._is_known = True
        return received_s
