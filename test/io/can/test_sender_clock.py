"""Stamps of a sender's clock become receive times of this machine, whatever that clock does."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_localizer.io.can.clock import LONGEST_WAKEUP_S, SenderClock

RATE_HZ = 100
T0_S = 1.7e9


def errors_s(
    sender: Callable[[float], float], frozen_s: tuple[float, float] = (0.0, 0.0), duration_s: float = 8.0
) -> tuple[np.ndarray, SenderClock]:
    """Converted stamps less the receive times of frames at 100 Hz, s; nothing is read in ``frozen_s``."""
    rng = np.random.default_rng(1)
    clock, errors, empty_s = SenderClock(), [], T0_S
    for sent_s in T0_S + np.arange(0, duration_s, 1 / RATE_HZ):
        received_s = sent_s + rng.exponential(1e-4)
        is_frozen = frozen_s[0] <= sent_s - T0_S < frozen_s[1]
        read_s = T0_S + frozen_s[1] if is_frozen else received_s + rng.uniform(0, 0.8) * LONGEST_WAKEUP_S
        empty_s = empty_s if is_frozen else read_s - LONGEST_WAKEUP_S
        errors.append(clock.receipt_s(sender(sent_s), empty_s, read_s) - received_s)
    return np.array(errors), clock


@given(
    offset_s=st.floats(-4000, 4000) | st.sampled_from([-T0_S, 0.0, 2.0, -0.2]),
    drift=st.floats(-0.05, 0.05) | st.sampled_from([0.0, 5e-5, -1e-3]),
    jump_s=st.floats(0.15, 1e4),
    forward=st.booleans(),
)
def test_stamps_stay_within_a_millisecond_of_receipt(
    offset_s: float, drift: float, jump_s: float, forward: bool
) -> None:
    jump_s = jump_s if forward else -jump_s

    def sender(time_s: float) -> float:
        elapsed_s = time_s - T0_S
        return time_s + offset_s + drift * elapsed_s + jump_s * (elapsed_s >= 2.995)

    errors, clock = errors_s(sender, duration_s=4.0)
    assert np.abs(errors).max() < 1e-3
    assert clock.jumps == 1, "drift is not a jump"
    assert clock.jump_s == pytest.approx(jump_s, abs=2e-3)
    assert clock.offset_s == pytest.approx(-offset_s - 4 * drift - jump_s, abs=3e-3)


def test_frames_that_waited_keep_their_receive_times() -> None:
    errors, clock = errors_s(lambda time_s: time_s - 3600.0, frozen_s=(3.0, 6.0))
    assert np.abs(errors).max() < 1e-3
    assert clock.jumps == 0
