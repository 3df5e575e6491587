"""The frames on a bus are cut into cycles by their order, whatever their pace."""

from collections.abc import Iterable

import numpy as np
import pytest

from tactile_localizer.io.can.cut import CycleCut, Pace

MS = 1_000_000
START_NS = 1_700_000_000_000_000_000
BURST = [(0, 0), (1, 1), (2, 2)]
"""Messages, and when they are sent in a cycle, ms."""


def first_frames(cut: CycleCut, frames: Iterable[tuple[int, float]]) -> list[tuple[int, float]]:
    """Those of ``frames``, each a message and its time, ms, that begin cycles; none is closed before."""
    first = []
    for k, t in frames:
        pace, stamp_ns = cut.paces[k], START_NS + round(t * MS)
        if cut.take(pace, stamp_ns, 1, is_due=pace.cycle == cut.number > 0):
            first.append((k, t))
    return first


def bursts(begins: Iterable[float], lost: Iterable[tuple[int, int]] = ()) -> list[tuple[int, float]]:
    return [(k, t + own) for n, t in enumerate(begins) for k, own in BURST if (n, k) not in lost]


@pytest.mark.parametrize("message", range(3))
def test_cycles_begin_behind_the_largest_gap(message: int) -> None:
    frames = bursts(10.0 * np.arange(20))[message:]
    assert first_frames(CycleCut(3, 0), frames) == [(0, 10.0 * n) for n in range(1 + (message > 0), 20)]


def test_cycles_do_not_depend_on_the_pace() -> None:
    begins = np.cumsum(np.random.default_rng(0).exponential(50.0, 300) + 5.0)
    assert first_frames(CycleCut(3, 0), bursts(begins)) == [(0, t) for t in begins[1:]]


@pytest.mark.parametrize("delay_ms", [7.0, 8.0, 13.0, 300.0])
def test_a_delay_of_the_whole_bus_does_not_change_the_cycles(delay_ms: float) -> None:
    frames = bursts(10.0 * np.arange(60))
    held = [(k, max(t, 301.5 + delay_ms + 1e-3 * t) if t > 301.5 else t) for k, t in frames]
    begins = first_frames(CycleCut(3, 0), held)
    assert begins == [held[3 * n] for n in range(1, 60)]


@pytest.mark.parametrize("seed", range(5))
def test_a_sender_that_catches_up_does_not_change_the_cycles(seed: int) -> None:
    """It was put aside for ten cycles, and sends them at once, with whatever gaps between the frames."""
    frames = bursts(10.0 * np.arange(60))
    gaps = np.random.default_rng(seed).uniform(0.02, 0.1, (10, 3)) * [1.0, 1.0, 6.0]
    late = 400.0 + gaps.cumsum().ravel()
    sent = [(k, late[n - 90] if 90 <= n < 120 else t) for n, (k, t) in enumerate(frames)]
    assert first_frames(CycleCut(3, 0), sent) == [sent[3 * n] for n in range(1, 60)]


def test_a_cycle_whose_first_frame_is_lost_does_not_take_those_of_the_next() -> None:
    lost = [(20, 0), (40, 0), (41, 0), (50, 1)]
    begins = first_frames(CycleCut(3, 0), bursts(10.0 * np.arange(60), lost))
    late = {20: (1, 201.0), 40: (1, 401.0), 41: (1, 411.0)}
    assert begins == [late.get(n, (0, 10.0 * n)) for n in range(1, 60)]


def test_a_frame_behind_one_that_follows_it_in_the_order_is_of_the_next_cycle() -> None:
    lost = {(19, 2), (20, 1), (21, 0), (30, 1), (31, 0), (31, 1), (32, 0)}
    begins = first_frames(CycleCut(3, 0), bursts(10.0 * np.arange(60), lost))
    later = {21: (1, 211.0), 31: (2, 312.0), 32: (1, 321.0)}
    assert begins == [later.get(n, (0, 10.0 * n)) for n in range(1, 60)]


def test_a_frame_that_the_next_cycle_overtakes_is_in_none() -> None:
    times = 10.0 * np.arange(60)[:, None] + [0.0, 3.0, 6.0]
    times[30, 2] += 4.5
    frames = sorted(((k, t) for row in times for k, t in enumerate(row)), key=lambda one: one[1])
    cut, found = CycleCut(3, 0), []
    for k, t in frames:
        if cut.take_into_previous(cut.paces[k], START_NS + round(t * MS)):
            found.append((k, t))
        else:
            first_frames(cut, [(k, t)])
    assert found == [(2, 310.5)]
    assert cut.number == 59


@pytest.mark.parametrize("message", range(3))
def test_load_cells_that_send_irregularly_keep_their_cycles_if_bursts_are_starved(message: int) -> None:
    """Reception begins within a burst; the first bursts are interrupted for longer than between them."""
    begins = 30.0 * np.arange(1, 40) + np.random.default_rng(0).uniform(-1.0, 1.0, 39)
    times = begins[:, None] + [0.0, 1.0, 2.0]
    times[3:6, 1:] += 20.0
    frames = [(k, t) for row in times for k, t in enumerate(row)][message:]
    cut = CycleCut(3, 1000 * MS)
    assert first_frames(cut, frames) == [(0, t) for t in begins[1 + (message > 0) :]]


def test_a_pause_within_the_first_burst_spoils_one_cycle() -> None:
    times = 10.0 * np.arange(20)[:, None] + [0.0, 1.0, 2.0]
    times[0, 2] += 20.0
    times[1:] += 25.0
    begins = first_frames(CycleCut(3, 1000 * MS), [(k, t) for row in times for k, t in enumerate(row)])
    assert begins == [(2, times[1, 2]), *((0, t) for t in times[3:, 0])]


def test_the_cut_moves_to_a_larger_gap() -> None:
    times = 10.0 * np.arange(100)[:, None] + [0, 6]
    times[50:, 1] -= 4
    frames = [(k, t) for row in times for k, t in enumerate(row)]
    begins = [k for k, _ in first_frames(CycleCut(2, 0), frames)]
    assert begins == [1] * begins.count(1) + [0] * begins.count(0)
    assert 50 <= begins.count(1) < 60
    assert len(begins) >= 97


def test_a_clock_that_is_set_back_while_the_first_load_cell_falls_silent_is_followed() -> None:
    cut = CycleCut(3, 0)
    first_frames(cut, bursts(10.0 * np.arange(20)))
    cut.restart()
    begins = first_frames(cut, bursts(10.0 * np.arange(20) - 30_000.0, [(n, 0) for n in range(20)]))
    assert begins == [(1, 10.0 * n - 29_999.0) for n in range(1, 20)]


def test_periods_are_those_of_the_messages() -> None:
    cut = CycleCut(2, 0)
    times = [(0, 10.0 * n) for n in range(200)] + [(1, 50.0 * n + 3.0) for n in range(40)]
    first_frames(cut, sorted(times, key=lambda one: one[1]))
    assert cut.period_ns == 10 * MS
    assert [pace.period_ns for pace in cut.paces] == [10 * MS, 50 * MS]
    assert [pace.cycles_per_sample for pace in cut.paces] == [1, 5]


def test_a_load_cell_that_loses_most_samples_in_lumps_is_not_slow():
    pace = Pace()
    for number in range(64):
        cycles = 1 if number % 2 or number < 8 else 4
        pace.note(cycles * 1_000_000, cycles, 1)
    pace.estimate()
    pace.compare(1_000_000.0)
    assert pace.period_ns > 2_000_000
    assert pace.cycles_per_sample == 1.0
