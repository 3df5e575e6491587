"""The samples on a bus are put into cycles by their order, whatever their pace."""

from collections.abc import Iterable, Sequence

import can
import numpy as np
import pytest
from support.load_cells import write_cells

from tactile_localizer.io.can.assembler import CycleAssembler
from tactile_localizer.io.can.load_cell import LoadCell, Stream
from tactile_localizer.io.can.protocol import LoadCellProtocol

MS = 1_000_000
START_NS = 1_700_000_000_000_000_000
BURST = [(0, 0), (1, 1), (2, 2)]
"""Messages, and when they are sent in a cycle, ms."""


@pytest.fixture(scope="module")
def hand(tmp_path_factory: pytest.TempPathFactory) -> LoadCellProtocol:
    """Three load cells of one gauge and one message each, without counters."""
    names = ["cell0", "cell1", "cell2"]
    path = tmp_path_factory.mktemp("dbc") / "hand.dbc"
    return LoadCellProtocol(write_cells(path, dict.fromkeys(names, ("gauge_1",))), names)


def cycles(
    hand: LoadCellProtocol, frames: Sequence[tuple[int, float]], period_s: float = 0.0
) -> list[list[tuple[int, float]]]:
    """The frames, each of a load cell at a time, ms, in each cycle, in the order of their reception."""
    assembler = CycleAssembler(hand, period_s)
    sent = [
        can.Message(
            timestamp=1e-9 * (START_NS + round(t * MS)),
            arbitration_id=256 + k,
            is_extended_id=False,
            data=row.to_bytes(2, "little"),
        )
        for row, (k, t) in enumerate(frames)
    ]
    made = assembler.feed(sent) + assembler.flush(START_NS + 10**15)
    assert len(assembler.counts.phalanges) == 3
    assert all(one.drops == 0 for one in assembler.counts.phalanges)
    return [sorted(frames[int(row)] for row in one.strain[np.isfinite(one.strain)]) for one in made]


def first_frames(
    hand: LoadCellProtocol, frames: Sequence[tuple[int, float]], period_s: float = 0.0
) -> list[tuple[int, float]]:
    """The first frame of each cycle."""
    return [min(one, key=lambda frame: frame[1]) for one in cycles(hand, frames, period_s)]


def bursts(begins: Iterable[float], lost: Iterable[tuple[int, int]] = ()) -> list[tuple[int, float]]:
    return [(k, t + own) for n, t in enumerate(begins) for k, own in BURST if (n, k) not in lost]


@pytest.mark.parametrize("message", range(3))
def test_cycles_begin_behind_the_largest_gap(hand: LoadCellProtocol, message: int) -> None:
    frames = bursts(10.0 * np.arange(20))[message:]
    assert first_frames(hand, frames) == [(0, 10.0 * n) for n in range(message > 0, 20)]


def test_cycles_do_not_depend_on_the_pace(hand: LoadCellProtocol) -> None:
    begins = np.cumsum(np.random.default_rng(0).exponential(50.0, 300) + 5.0)
    assert first_frames(hand, bursts(begins)) == [(0, t) for t in begins]


@pytest.mark.parametrize("delay_ms", [7.0, 8.0, 13.0, 300.0])
def test_a_delay_of_the_whole_bus_does_not_change_the_cycles(hand: LoadCellProtocol, delay_ms: float) -> None:
    frames = bursts(10.0 * np.arange(60))
    held = [(k, max(t, 301.5 + delay_ms + 1e-3 * t) if t > 301.5 else t) for k, t in frames]
    begins = first_frames(hand, held)
    assert begins == held[::3]


@pytest.mark.parametrize("seed", range(5))
def test_a_sender_that_catches_up_does_not_change_the_cycles(hand: LoadCellProtocol, seed: int) -> None:
    """It was put aside for ten cycles, and sends them at once, with whatever gaps between the frames."""
    frames = bursts(10.0 * np.arange(60))
    gaps = np.random.default_rng(seed).uniform(0.02, 0.1, (10, 3)) * [1.0, 1.0, 6.0]
    late = 400.0 + gaps.cumsum().ravel()
    sent = [(k, late[n - 90] if 90 <= n < 120 else t) for n, (k, t) in enumerate(frames)]
    assert first_frames(hand, sent) == sent[::3]


def test_a_cycle_whose_first_frame_is_lost_does_not_take_those_of_the_next(hand: LoadCellProtocol) -> None:
    lost = [(20, 0), (40, 0), (41, 0), (50, 1)]
    begins = first_frames(hand, bursts(10.0 * np.arange(60), lost))
    late = {20: (1, 201.0), 40: (1, 401.0), 41: (1, 411.0)}
    assert begins == [late.get(n, (0, 10.0 * n)) for n in range(60)]


def test_a_frame_behind_one_that_follows_it_in_the_order_is_of_the_next_cycle(hand: LoadCellProtocol) -> None:
    lost = {(19, 2), (20, 1), (21, 0), (30, 1), (31, 0), (31, 1), (32, 0)}
    begins = first_frames(hand, bursts(10.0 * np.arange(60), lost))
    later = {21: (1, 211.0), 31: (2, 312.0), 32: (1, 321.0)}
    assert begins == [later.get(n, (0, 10.0 * n)) for n in range(60)]


def test_a_frame_that_the_next_cycle_overtakes_is_in_none(hand: LoadCellProtocol) -> None:
    times = 10.0 * np.arange(60)[:, None] + [0.0, 3.0, 6.0]
    times[30, 2] += 4.5
    frames = sorted(((k, t) for row in times for k, t in enumerate(row)), key=lambda one: one[1])
    made = cycles(hand, frames)
    assert [[t for _, t in one] for one in made[:30] + made[31:]] == times[np.arange(60) != 30].tolist()
    assert made[30] == [(0, 300.0), (1, 303.0)]


@pytest.mark.parametrize("message", range(3))
def test_load_cells_that_send_irregularly_keep_their_cycles_if_bursts_are_starved(
    hand: LoadCellProtocol, message: int
) -> None:
    """Reception begins within a burst; the first bursts are interrupted for longer than between them."""
    begins = 30.0 * np.arange(1, 40) + np.random.default_rng(0).uniform(-1.0, 1.0, 39)
    times = begins[:, None] + [0.0, 1.0, 2.0]
    times[3:6, 1:] += 20.0
    frames = [(k, t) for row in times for k, t in enumerate(row)][message:]
    assert first_frames(hand, frames, period_s=1.0) == [(0, t) for t in begins[message > 0 :]]


def test_a_pause_within_the_first_burst_costs_no_sample(hand: LoadCellProtocol) -> None:
    times = 10.0 * np.arange(20)[:, None] + [0.0, 1.0, 2.0]
    times[0, 2] += 20.0
    times[1:] += 25.0
    made = cycles(hand, [(k, t) for row in times for k, t in enumerate(row)], period_s=1.0)
    assert sum(map(len, made)) >= 20 * 3 - 2, "but before the first begin"
    assert [len(one) for one in made if len(one) < 3] == [1], "where the begin was mended"
    assert [min(one)[1] for one in made[-12:]] == times[-12:, 0].tolist(), "by the largest gap"


def test_cycles_begin_behind_a_gap_that_becomes_larger(hand: LoadCellProtocol) -> None:
    times = 10.0 * np.arange(100)[:, None] + [0, 6, 7]
    times[50:, 1:] -= 4
    made = cycles(hand, [(k, t) for row in times for k, t in enumerate(row)])
    begins = [one[0] if one[0][1] < one[-1][1] else one[-1] for one in made]
    assert sum(map(len, made)) >= 298
    assert [len(one) for one in made if len(one) < 3] == [2], "where the begin moved"
    assert begins[-40:] == [(0, t) for t in times[-40:, 0]]


def test_a_clock_that_is_set_back_while_the_first_load_cell_falls_silent_is_followed(
    hand: LoadCellProtocol,
) -> None:
    later = bursts(10.0 * np.arange(20) - 30_000.0, [(n, 0) for n in range(20)])
    begins = first_frames(hand, bursts(10.0 * np.arange(20)) + later)
    assert begins[-19:] == [(1, 10.0 * n - 29_999.0) for n in range(1, 20)]


def test_periods_are_those_of_the_load_cells(hand: LoadCellProtocol) -> None:
    times = [(0, 10.0 * n) for n in range(200)] + [(1, 50.0 * n + 3.0) for n in range(40)]
    assembler = CycleAssembler(hand)
    assembler.feed(
        [
            can.Message(
                timestamp=1.7e9 + 1e-3 * t, arbitration_id=256 + k, is_extended_id=False, data=bytes(2)
            )
            for k, t in sorted(times, key=lambda one: one[1])
        ]
    )
    assert assembler.period_ns == pytest.approx(10 * MS, rel=1e-4)
    fast, slow, _ = assembler.counts.phalanges
    assert (fast.cycles_per_sample, slow.cycles_per_sample) == (1, 5)


def test_a_load_cell_that_loses_most_samples_in_lumps_is_not_slow() -> None:
    cell = LoadCell()
    cell.streams.append(Stream(cell, slice(0, 1), None))
    cycle = 0
    for number in range(65):
        cycle += 1 if number % 2 or number < 8 else 4
        cell.begin_ns = START_NS + cycle * MS
        cell.streams[0].sequence += 1
        cell.note(cycle)
    cell.compare(1_000_000.0)
    assert cell.period_ns > 2_000_000
    assert cell.counts.cycles_per_sample == 1.0
