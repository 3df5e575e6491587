"""Frames become cycles by time, and samples by the load cell's counter."""

from copy import copy
from pathlib import Path

import can
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.load_cells import PERIOD_NS, START_NS, cycle, number_of, protocol, sample, write_cells

from tactile_localizer.io.can.assembler import Cycle, CycleAssembler
from tactile_localizer.io.can.layout import SignalNames
from tactile_localizer.io.can.load_cell import SHORTEST_PERIOD_NS
from tactile_localizer.io.can.protocol import FrameKind, LoadCellProtocol
from tactile_localizer.io.status import FAULT, MISSING, OK, SATURATED

HAND = protocol()
HAND_FD = protocol(dbc="loadcells_fd.dbc")
PERIOD_S = PERIOD_NS * 1e-9
MS = 1_000_000
FRAMES = [frame for n in range(100) for frame in cycle(HAND, n)]
"""Frames of 100 cycles, made once because encoding is slow."""


def started(hand: LoadCellProtocol = HAND, period_s: float = PERIOD_S) -> CycleAssembler:
    """An assembler that has received samples -3 to -1 of every load cell."""
    assembler = CycleAssembler(hand, period_s)
    assembler.feed([frame for n in (-3, -2, -1) for frame in cycle(hand, n)])
    return assembler


def assembled(frames: list[can.Message], assembler: CycleAssembler | None = None) -> list[Cycle]:
    """All cycles of ``frames``."""
    assembler = assembler or started()
    made = assembler.feed(frames)
    return made + assembler.flush(START_NS + 10**12)


def samples(cycles: list[Cycle]) -> list[list[int | None]]:
    """Number of the sample of each phalanx in each cycle; fails if its voltages are of several samples."""
    return [
        [
            None if s & MISSING else number_of(p, one.strain[8 * p : 8 * p + 8])
            for p, s in enumerate(one.status)
        ]
        for one in cycles
    ]


def delayed(frame: can.Message, delay_ns: int) -> can.Message:
    late = copy(frame)
    late.timestamp += delay_ns * 1e-9
    return late


def stamp_ns_of(frame: can.Message) -> int:
    return round(frame.timestamp * 1e9)


def sent_at(frame: can.Message, stamp_ns: int) -> can.Message:
    return delayed(frame, stamp_ns - stamp_ns_of(frame))


def in_order(frames: list[can.Message]) -> list[can.Message]:
    return sorted(frames, key=lambda frame: frame.timestamp)


@pytest.mark.parametrize("hand", [HAND, HAND_FD], ids=["classic", "fd"])
def test_each_cycle_holds_one_sample_of_every_phalanx(hand: LoadCellProtocol) -> None:
    assembler = started(hand)
    made = [one for n in range(100) for one in assembler.feed(cycle(hand, n))]  # complete at once
    assert samples(made) == [[n, n] for n in range(100)]
    assert [one.stamp_ns for one in made] == pytest.approx([START_NS + n * PERIOD_NS for n in range(100)])
    assert np.ptp([one.sequence - n for n, one in enumerate(made)]) == 0  # the counter is unwrapped
    assert all(counts.missing == 0 for counts in assembler.counts.phalanges)


@given(
    delays=st.lists(st.integers(0, 900_000), min_size=60, max_size=60),
    skew_ns=st.integers(-600_000, 600_000),
)
def test_jitter_neither_splits_nor_loses_cycles(delays: list[int], skew_ns: int) -> None:
    frames = [delayed(frame, delays[i // 2] + i // 2 % 2 * skew_ns) for i, frame in enumerate(FRAMES[:120])]
    assembler = started(period_s=0.0)
    assert samples(assembled(in_order(frames), assembler))[-28:] == [[n, n] for n in range(2, 30)]


@given(data=st.data())
def test_no_sample_is_composed_of_frames_of_two(data: st.DataObject) -> None:
    """Lost, late, repeated and exchanged frames, in any mixture, with a counter of 4 bits."""
    frames = FRAMES[:240]
    lost = data.draw(st.sets(st.integers(0, len(frames) - 1), max_size=120))
    repeated = data.draw(st.sets(st.integers(0, len(frames) - 1), max_size=20))
    late = data.draw(st.dictionaries(st.integers(0, len(frames) - 1), st.integers(0, 20 * MS), max_size=20))
    sent = []
    for i, frame in enumerate(frames):
        sent += [] if i in lost else [delayed(frame, late.get(i, 0))] * (1 + (i in repeated))
    assembler = CycleAssembler(HAND, data.draw(st.sampled_from([0.0, PERIOD_S])))
    before = [frame for n in range(-10, 0) for frame in cycle(HAND, n)]
    del before[12], before[18]  # the counters are equal again after losses: they are common
    cycles = assembled([*before, *in_order(sent)], assembler)
    samples(cycles)  # fails on a mixture
    counts = assembler.counts
    assert sum(counts.frames) == len(before) + len(sent)
    assert counts.cycles == len(cycles)
    for p, phalanx in enumerate(counts.phalanges):
        assert phalanx.samples + phalanx.missing == counts.cycles
        assert phalanx.missing == sum(bool(one.status[p] & MISSING) for one in cycles)


@given(lost=st.sets(st.integers(4, 4 * 99 - 1), max_size=60))
def test_lost_frames_are_counted_exactly(lost: set[int]) -> None:
    assembler = started()
    made = assembled([frame for i, frame in enumerate(FRAMES) if i not in lost], assembler)
    assert sum(phalanx.drops for phalanx in assembler.counts.phalanges) == len(lost)
    whole = [[None if {4 * n + 2 * p, 4 * n + 2 * p + 1} & lost else n for p in range(2)] for n in range(100)]
    assert samples(made) == [numbers for numbers in whole if numbers != [None, None]]


@pytest.mark.parametrize("silence", [5, 16, 432, 435])
@pytest.mark.parametrize("seed", range(3))
def test_a_silence_is_counted_exactly_at_any_pace_of_the_sender(silence: int, seed: int) -> None:
    """Also if it lasts exactly as long as the counter takes to wrap, once or several times."""
    rng = np.random.default_rng(seed)
    is_fast = np.repeat(rng.random(30) < 0.5, 20)
    intervals_s = np.where(is_fast, rng.uniform(0.001, 0.004, 600), rng.uniform(0.01, 0.08, 600))
    assembler = CycleAssembler(HAND, period_s=1.0)
    for n, stamp_ns in enumerate(START_NS + (1e9 * np.cumsum(intervals_s)).astype(int)):
        is_silent = 130 <= n < 130 + silence
        assembler.feed(sample(HAND, 0, n, stamp_ns) if is_silent else cycle(HAND, n, stamp_ns))
    first, second = assembler.counts.phalanges
    assert (first.samples, second.samples) == (599, 599 - silence), "the first one is of unknown begin"
    assert (first.drops, second.drops) == (0, 2 * silence)
    assert (first.jumps, second.jumps) == (0, 0)
    assert (first.cycles_per_sample, second.cycles_per_sample) == (1, 1)


def test_a_sample_that_is_late_is_in_its_cycle_if_nothing_else_was_received_meanwhile() -> None:
    frames = FRAMES[:160]
    frames[102:104] = [delayed(frame, 3 * MS) for frame in frames[102:104]]  # sample 25 of the second phalanx
    assert samples(assembled(in_order(frames))) == [[n, n] for n in range(40)]


def test_reordered_and_duplicate_frames_are_used_once() -> None:
    frames = [frame for n in range(10) for frame in cycle(HAND, n)[::-1]]
    frames[21:21] = [frames[20]]  # repeated while its sample is incomplete
    frames[30:30] = [delayed(frames[28], PERIOD_NS // 4)]  # and afterwards
    assembler = started()
    assert samples(assembled(frames, assembler)) == [[n, n] for n in range(10)]
    assert assembler.counts.frames[FrameKind.DUPLICATE] == 2


def test_a_frame_of_an_earlier_sample_is_out_of_order() -> None:
    frames = FRAMES[:40]
    frames.insert(25, delayed(frames.pop(21), PERIOD_NS))
    assembler = started()
    numbers = samples(assembled(frames, assembler))
    assert numbers == [[n, n] if n != 5 else [None, 5] for n in range(10)]
    assert assembler.counts.frames[FrameKind.OUT_OF_ORDER] == 1
    assert assembler.counts.phalanges[0].drops == 1


def test_no_sample_is_lost_when_another_load_cell_comes_first() -> None:
    late = [delayed(frame, 4 * PERIOD_NS // 5 * (k >= 200 and k % 4 > 1)) for k, frame in enumerate(FRAMES)]
    assembler = started()
    numbers = samples(assembled(in_order(late), assembler))
    for phalanx in zip(*numbers, strict=True):
        assert [number for number in phalanx if number is not None] == [*range(100)]
    (split,) = (row for row, pair in enumerate(numbers[:-1]) if None in pair)
    assert 50 < split < 60
    assert [counts.drops for counts in assembler.counts.phalanges] == [0, 0]


def test_a_restarted_load_cell_is_a_warning_and_loses_nothing() -> None:
    frames = [frame for n in range(3000, 3050) for frame in cycle(HAND_FD, n)]
    for n in range(50, 180):
        stamp_ns = START_NS + (3000 + n) * PERIOD_NS
        frames += sample(HAND_FD, 0, 3000 + n, stamp_ns)
        frames += sample(HAND_FD, 1, n - 150, stamp_ns) if n >= 150 else []
    assembler = CycleAssembler(HAND_FD, PERIOD_S)
    numbers = samples(assembled(frames, assembler))
    assert len(numbers) == 180
    assert numbers[-1] == [179, 29]
    first, second = assembler.counts.phalanges
    assert (first.jumps, first.drops) == (0, 0)
    assert (second.jumps, second.drops) == (1, 0)


@pytest.mark.parametrize("rate_hz", [50, 200, 1000])
def test_the_period_is_estimated_from_the_stream(rate_hz: int) -> None:
    assembler = CycleAssembler(HAND)
    made = []
    for n in range(40):
        made += assembler.feed(cycle(HAND, n, START_NS + n * 1_000_000_000 // rate_hz))
    assert assembler.period_ns == pytest.approx(1e9 / rate_hz, rel=0.01)
    assert samples(made) == [[n, n] for n in range(1, 40)]  # the first cycle has no period yet
    assembler.feed(cycle(HAND, 40, START_NS + 10**11))
    assert assembler.period_ns < 1.3e9 / rate_hz, "a pause counts as two periods"
    for n in range(41, 141):  # an adapter that hands over what it collected
        assembler.feed(cycle(HAND, n, START_NS + 10**11))
    assert assembler.period_ns == SHORTEST_PERIOD_NS


@pytest.mark.parametrize("period_s", [0.0, 1.0])
@pytest.mark.parametrize("missed", range(4))
def test_a_reception_that_begins_within_a_cycle_mixes_no_samples(period_s: float, missed: int) -> None:
    assembler = CycleAssembler(HAND, period_s)
    made = samples(assembled(FRAMES[missed:80], assembler))
    assert made == [[n, n] for n in range(1 + (missed > 0), 20)]
    assert [one.drops for one in assembler.counts.phalanges] == [0, 0]


@given(
    missed=st.integers(0, 3),
    gaps_us=st.lists(st.integers(10, 5000), min_size=0, max_size=32),
    stall=st.tuples(st.integers(0, 15), st.integers(1, 20)),
)
def test_what_is_received_before_the_begin_of_the_cycles_is_known_is_not_lost(
    missed: int, gaps_us: list[int], stall: tuple[int, int]
) -> None:
    """Of a sender that is put aside within its first cycles, or sends them at once."""
    early_ns = START_NS + 1000 * np.cumsum([*gaps_us, 0])
    frames = [sent_at(one, int(t)) for one, t in zip(FRAMES[missed:], early_ns[:-1], strict=False)]
    after, delay_ns = missed + len(frames), stall[1] * PERIOD_NS // 2
    shift_ns = int(early_ns[-1]) - stamp_ns_of(FRAMES[after]) + PERIOD_NS
    frames += [delayed(one, shift_ns + delay_ns * (k >= stall[0])) for k, one in enumerate(FRAMES[after:240])]
    assembler = CycleAssembler(HAND)
    made = samples(assembled(frames, assembler)[-30:])
    assert [one.drops for one in assembler.counts.phalanges] == [0, 0]
    assert made == [[n, n] for n in range(30, 60)], "whole, and those that follow"
    del frames[-21]
    assembled(frames, assembler := CycleAssembler(HAND))
    assert sum(one.drops for one in assembler.counts.phalanges) == 1, "one that is lost afterwards"


@pytest.mark.parametrize("missed", range(4))
def test_what_passed_during_a_pause_is_neither_counted_as_lost_nor_mixed(missed: int) -> None:
    assembler = started()
    assembler.feed(FRAMES[:20])
    assembler.reset()
    made = samples(assembled(FRAMES[36 + missed : 48], assembler))
    assert made == [[n, n] for n in range(9 + (missed > 0), 12)]
    assert [(one.drops, one.jumps) for one in assembler.counts.phalanges] == [(0, 0)] * 2


def test_the_last_cycle_is_closed_after_a_silence() -> None:
    assembler = started()
    assert assembler.feed(cycle(HAND, 0)[:3]) == []
    remaining_ns = assembler.remaining_ns(START_NS + MS)
    assert remaining_ns is not None
    assert 2 * PERIOD_NS < remaining_ns < 4 * PERIOD_NS
    assert assembler.remaining_ns(START_NS - 10**10) == 0, "the clock was set back"
    assert assembler.flush(START_NS + remaining_ns) == []
    assert samples(assembler.flush(START_NS + remaining_ns + MS)) == [[0, None]]
    assert assembler.remaining_ns(START_NS) is None


@pytest.mark.parametrize("read", [1, 2, 3])
def test_a_cycle_whose_other_frames_are_late_is_closed_before_newer_ones(read: int) -> None:
    assembler = started()
    made = assembler.feed(FRAMES[:read])
    oldest_ns = START_NS + 50 * PERIOD_NS - MS
    made += assembler.feed(FRAMES[read : 4 * 50], oldest_ns)
    assert samples(made) == ([[0, None]] if read >= 2 else [])
    assert samples(assembler.feed(FRAMES[4 * 50 :], oldest_ns)) == [[n, n] for n in range(50, 100)]
    assert assembler.counts.frames[FrameKind.LATE] == 4 * 50 - read


@pytest.mark.parametrize("step_s", [-30.0, 30.0])
def test_a_clock_step_costs_at_most_one_cycle(step_s: float) -> None:
    frames = FRAMES[:160]
    stepped = [delayed(frame, round(step_s * 1e9) if i >= 82 else 0) for i, frame in enumerate(frames)]
    numbers = samples(assembled(stepped))
    assert [one for one in numbers if None not in one] == [[n, n] for n in range(40) if n != 20]


def test_foreign_and_invalid_frames_are_counted_and_ignored() -> None:
    known = {"arbitration_id": HAND.messages[0].key[0], "is_extended_id": False}
    invalid = {
        FrameKind.UNKNOWN_ID: can.Message(**{**known, "is_extended_id": True}, data=bytes(8)),
        FrameKind.WRONG_LENGTH: can.Message(**known, data=bytes(3)),
        FrameKind.REMOTE: can.Message(**known, is_remote_frame=True, dlc=8),
        FrameKind.ERROR: can.Message(arbitration_id=4, is_error_frame=True, data=bytes(8)),
    }
    assembler = started()
    frames = [frame for one in FRAMES[:80] for frame in (one, *invalid.values())]
    assert samples(assembled(frames, assembler)) == [[n, n] for n in range(20)]
    expected = dict.fromkeys(invalid, 80) | {FrameKind.DATA: 92}
    assert assembler.counts.frames == [expected.get(kind, 0) for kind in FrameKind]


def test_faults_and_saturation_are_statuses_of_the_phalanx() -> None:
    assembler = started()
    stamp_s = START_NS * 1e-9
    frames = HAND.encode(0, np.full(8, 9.0), 0, stamp_s=stamp_s)
    frames += HAND.encode(1, np.zeros(8), 0, status=3, stamp_s=stamp_s)
    (made,) = assembled(frames, assembler)
    assert made.status.tolist() == [SATURATED, FAULT]
    assert [(one.saturated, one.faults) for one in assembler.counts.phalanges] == [(1, 0), (0, 1)]


def test_phalanges_have_the_channels_of_the_dbc(tmp_path: Path) -> None:
    gauges = [f"ch_{n}" for n in range(1, 20)]
    path = write_cells(tmp_path / "own.dbc", {"index": gauges, "thumb": gauges[:3]}, "8 [0|0]", volts=0.001)
    hand = LoadCellProtocol(path, ["index", "thumb"], names=SignalNames(tuple(gauges)))
    assert hand.channels.counts == (19, 3)
    strain = 0.001 * np.arange(22.0)
    index, thumb = (
        hand.encode(p, strain[part], 0, stamp_s=START_NS * 1e-9)
        for p, part in enumerate(hand.channels.slices)
    )
    sent = [delayed(frame, n * PERIOD_NS) for n in range(3) for frame in index + thumb]
    *_, whole, part = assembled(sent[:-1], CycleAssembler(hand, PERIOD_S))
    np.testing.assert_allclose(whole.strain, strain, atol=1e-12)
    assert part.status.tolist() == [OK, MISSING]
    np.testing.assert_allclose(part.strain[:19], strain[:19], atol=1e-12)
    assert np.isnan(part.strain[19:]).all()


def put_aside(seed: int, order: tuple[int, ...], share: float, begin: int = 0) -> list[can.Message]:
    """100 cycles whose sender is put aside before a share of its frames, from one on."""
    rng = np.random.default_rng(seed)
    frames, stamp_ns = [], START_NS
    for n in range(100):
        stamp_ns = max(stamp_ns, START_NS + n * PERIOD_NS)
        for k in order:
            stalls = rng.random(2) < share * (n >= begin)
            stamp_ns += int(rng.uniform(2e4, 3e5) + stalls.sum() * rng.exponential(3 * PERIOD_NS))
            frames.append(sent_at(FRAMES[4 * n + k], stamp_ns))
    return frames


in_both_orders = pytest.mark.parametrize("order", [(0, 1, 2, 3), (0, 2, 1, 3)], ids=["in turn", "mixed"])


@pytest.mark.parametrize("seed", [0, 2, 14, 16, 24, 43])
@in_both_orders
def test_nothing_is_lost_of_a_sender_that_is_put_aside_again_and_again(
    seed: int, order: tuple[int, ...]
) -> None:
    cycles = assembled(put_aside(seed, order, 0.05), assembler := CycleAssembler(HAND))
    counts = assembler.counts.phalanges
    assert [(one.drops, one.jumps) for one in counts] == [(0, 0)] * 2
    assert min(one.samples for one in counts) >= 97
    assert len(cycles) <= 103


@pytest.mark.parametrize("seed", range(4))
@in_both_orders
def test_once_counters_were_equal_no_sample_is_of_two_however_long_a_sender_is_put_aside(
    seed: int, order: tuple[int, ...]
) -> None:
    cycles = assembled(put_aside(seed, order, 0.15, begin=20), CycleAssembler(HAND))
    for phalanx in zip(*samples(cycles), strict=True):
        received = [number for number in phalanx if number is not None]
        assert received == [*range(received[0], 100)]
