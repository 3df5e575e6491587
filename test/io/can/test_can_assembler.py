"""Frames are assembled into cycles; missing parts are marked and counted, and cycles never mixed."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import can
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.load_cells import PERIOD_NS, START_NS, cycle, number_of, protocol, sample, strain_of, warm_up

from tactile_localizer.io.can.assembler import CycleAssembler
from tactile_localizer.io.can.breaks import CONFIRMATION
from tactile_localizer.io.can.cycle import Cycle
from tactile_localizer.io.can.protocol import FrameKind, LoadCellProtocol
from tactile_localizer.io.status import FAULT, MISSING, OK, SATURATED
from tactile_localizer.resources import resource_path

WAIT_S = 0.004
HAND = protocol()


def feed(assembler: CycleAssembler, frames: Iterable[can.Message]) -> list[Cycle]:
    """One at a time: what a frame's batch is must not matter."""
    return [made for frame in frames for made in assembler.feed([frame])]


def without_counter(tmp_path: Path) -> LoadCellProtocol:
    path = tmp_path / "plain.dbc"
    path.write_text(resource_path("config/loadcells.dbc").read_text().replace(" counter ", " unused "))
    return LoadCellProtocol.from_dbc(path, ["index", "middle"])


@pytest.mark.parametrize("batch", [1, 3, 4, 1000])
def test_a_cycle_has_the_stamp_of_its_first_frame(batch: int) -> None:
    assembler = warm_up(CycleAssembler(HAND, WAIT_S), HAND)
    frames = [frame for n in range(40) for frame in cycle(HAND, n)]
    made = [one for i in range(0, len(frames), batch) for one in assembler.feed(frames[i : i + batch])]
    assert len(made) == 40
    for n, one in enumerate(made):
        np.testing.assert_allclose(one.strain, np.concatenate([strain_of(0, n), strain_of(1, n)]))
        assert abs(one.stamp_ns - START_NS - n * PERIOD_NS) < 1000
        assert one.status.tolist() == [OK, OK]
        assert one.sequence.tolist() == [n, n]  # beyond the 4 bits of the counter
    assert assembler.counts.frames[FrameKind.DATA] == 160
    assert assembler.counts.incomplete == 0


@pytest.mark.parametrize("missed", [1, 2, 3])
def test_reception_that_begins_within_a_cycle_loses_no_frame(missed: int) -> None:
    assembler = CycleAssembler(HAND, WAIT_S)
    feed(assembler, [frame for n in range(40) for frame in cycle(HAND, n)][missed:])
    assert [phalanx.drops for phalanx in assembler.counts.phalanges] == [0, 0]


def test_a_partial_sample_is_missing() -> None:
    assembler = warm_up(CycleAssembler(HAND, WAIT_S), HAND)
    frames = cycle(HAND, 0) + cycle(HAND, 1)[1:] + cycle(HAND, 2)
    made = feed(assembler, frames)
    assert [one.status.tolist() for one in made] == [[OK, OK], [MISSING, OK], [OK, OK]]
    assert np.isnan(made[1].strain[:8]).all()
    assert number_of(1, made[1].strain[8:]) == 1
    index = assembler.counts.phalanges[0]
    assert (index.samples, index.missing, index.gaps, index.drops) == (2, 1, 0, 1)


def test_an_incomplete_cycle_that_the_next_one_closes_has_its_own_sequence() -> None:
    assembler = warm_up(CycleAssembler(HAND, 1.0), HAND)
    made = feed(assembler, cycle(HAND, 0) + cycle(HAND, 1)[:-1] + cycle(HAND, 2))
    assert [one.sequence.tolist() for one in made] == [[0, 0], [1, 1], [2, 2]]
    assert number_of(0, made[1].strain[:8]) == 1


def test_an_incomplete_cycle_is_published_after_the_timeout() -> None:
    assembler = warm_up(CycleAssembler(HAND, WAIT_S), HAND)
    assert feed(assembler, sample(HAND, 0, 0)) == []
    assert assembler.remaining_ns(START_NS) == pytest.approx(WAIT_S * 1e9, abs=1000)
    assert assembler.flush(START_NS + 3_900_000) == []
    (made,) = assembler.flush(START_NS + 4_100_000)
    assert made.status.tolist() == [OK, MISSING]
    assert assembler.remaining_ns(START_NS) is None


def test_garbage_does_not_delay_an_incomplete_cycle() -> None:
    assembler = warm_up(CycleAssembler(HAND, WAIT_S), HAND)
    feed(assembler, sample(HAND, 0, 0))
    garbage = can.Message(arbitration_id=0x7FF, is_extended_id=False, timestamp=START_NS * 1e-9 + 0.005)
    assert len(feed(assembler, [garbage])) == 1


def test_a_late_frame_is_dropped_and_counted() -> None:
    assembler = warm_up(CycleAssembler(HAND, WAIT_S), HAND)
    feed(assembler, cycle(HAND, 0) + sample(HAND, 0, 1) + sample(HAND, 1, 1)[:1])
    assert len(assembler.flush(START_NS + PERIOD_NS + 4_100_000)) == 1
    late = START_NS + PERIOD_NS + 4_200_000
    assert feed(assembler, sample(HAND, 1, 1, late)[1:]) == []
    (made,) = feed(assembler, cycle(HAND, 2))
    assert number_of(1, made.strain[8:]) == 2
    assert assembler.counts.frames[FrameKind.OUT_OF_ORDER] == 1
    assert assembler.counts.phalanges[1].drops == 1


def test_a_late_sample_does_not_join_the_next_cycle() -> None:
    assembler = warm_up(CycleAssembler(HAND, WAIT_S), HAND)
    feed(assembler, cycle(HAND, 0) + sample(HAND, 0, 1))
    assembler.flush(START_NS + 2 * PERIOD_NS)
    late = START_NS + 2 * PERIOD_NS
    made = feed(assembler, sample(HAND, 0, 2) + sample(HAND, 1, 1, late) + sample(HAND, 1, 2))
    assert [one.status.tolist() for one in made] == [[OK, OK]]
    assert number_of(1, made[0].strain[8:]) == 2
    assert assembler.counts.frames[FrameKind.OUT_OF_ORDER] == 2


def test_duplicate_and_old_frames_are_counted_by_kind() -> None:
    assembler = warm_up(CycleAssembler(HAND, WAIT_S), HAND)
    zero, one = cycle(HAND, 0, START_NS), cycle(HAND, 1, START_NS + 1_000_000)
    made = feed(assembler, [*zero, zero[1], *one[:2], one[0], zero[0], *one[2:]])
    assert [m.status.tolist() for m in made] == [[OK, OK]] * 2
    frames = assembler.counts.frames
    assert (frames[FrameKind.DATA], frames[FrameKind.DUPLICATE], frames[FrameKind.OUT_OF_ORDER]) == (8, 2, 1)


def test_frames_of_a_cycle_may_come_in_any_order() -> None:
    assembler = CycleAssembler(HAND, WAIT_S)
    rng = np.random.default_rng(3)
    made: list[Cycle] = []
    for n in range(200):
        frames = cycle(HAND, n)
        made += feed(assembler, [frames[i] for i in rng.permutation(4)])
    assert all(one.status.tolist() == [OK, OK] for one in made[60:])
    assert len(made) == 200
    for one in made:
        assert_of_one_sample(one)


@pytest.mark.parametrize("dbc", ["loadcells.dbc", "loadcells_fd.dbc"])
def test_a_silent_phalanx_is_missing_until_it_returns(dbc: str) -> None:
    hand = protocol(dbc=dbc)
    assembler = warm_up(CycleAssembler(hand, WAIT_S), hand)
    frames = [f for n in range(300) for f in (sample(hand, 0, n) if 100 <= n < 203 else cycle(hand, n))]
    made = [one for frame in frames for one in assembler.feed([frame])]
    assert [one.status[1] for one in made] == [OK] * 100 + [MISSING] * 103 + [OK] * 97
    assert all(one.status[0] == OK for one in made)
    middle = assembler.counts.phalanges[1]
    parts = len(sample(hand, 1, 0))
    assert (middle.samples, middle.missing, middle.unaligned) == (197, 103, 0)
    assert (middle.gaps, middle.drops) == (103, 103 * parts)
    assert made[-1].sequence.tolist() == [299, 299]  # though a counter of 4 bits went round six times


@pytest.mark.parametrize("phalanx", [0, 1])
@pytest.mark.parametrize("wait_s", [WAIT_S, 0.03])  # within the period, and six periods long
def test_a_returning_phalanx_does_not_join_the_previous_cycle(phalanx: int, wait_s: float) -> None:
    assembler = CycleAssembler(HAND, wait_s)
    made: list[Cycle] = []
    for n in range(300):
        frames = spread(n)
        if 100 <= n < 203:
            del frames[2 * phalanx : 2 * phalanx + 2]
        made += feed(assembler, frames)
    assert len(made) >= 290
    assert sum(MISSING in one.status for one in made) <= 103 + 12
    for one in made:
        assert_of_one_sample(one)


@pytest.mark.parametrize("phalanx", [0, 1])
@pytest.mark.parametrize("outage", [0, 5, 40])
def test_a_restarted_load_cell_is_missing_until_aligned(phalanx: int, outage: int) -> None:
    assembler = CycleAssembler(HAND, WAIT_S)
    made: list[Cycle] = []
    for n in range(1000, 1200):
        frames = sample(HAND, 1 - phalanx, n)
        if n < 1060:
            frames += sample(HAND, phalanx, n)
        elif n >= 1060 + outage:
            volts, count = strain_of(phalanx, n), n - 1060 - outage
            frames += HAND.encode(phalanx, volts, count, stamp_s=frames[0].timestamp)
        made += feed(assembler, frames)
    for one in made:
        assert_of_one_sample(one)
    assert [one.status[phalanx] for one in made[30:60]] == [OK] * 30
    assert all(one.status[phalanx] == OK for one in made[80 + outage :])
    assert all(one.status[1 - phalanx] == OK for one in made[30:])


@pytest.mark.parametrize("lost", [1, 5, 8, 9, 12, 13])
def test_lost_cycles_are_counted(lost: int) -> None:
    assembler = warm_up(CycleAssembler(HAND, WAIT_S), HAND)
    numbers = [0, 1, 2, *range(3 + lost, 3 + lost + CONFIRMATION + 1)]
    made = feed(assembler, [frame for n in numbers for frame in cycle(HAND, n)])
    assert [one.sequence.tolist() for one in made] == [[n, n] for n in numbers]
    assert assembler.counts.incomplete == 0
    assert assembler.counts.frames[FrameKind.OUT_OF_ORDER] == 0
    assert [(p.gaps, p.drops) for p in assembler.counts.phalanges] == [(lost, 2 * lost)] * 2


@pytest.mark.parametrize("jump_ns", [-3_600 * 10**9, -(10**9), 3_600 * 10**9])
def test_a_clock_step_between_cycles_costs_nothing(jump_ns: int) -> None:
    assembler = warm_up(CycleAssembler(HAND, WAIT_S), HAND)
    made = feed(assembler, [frame for n in range(20) for frame in cycle(HAND, n)])
    stamps = [START_NS + jump_ns + n * PERIOD_NS for n in range(20, 40)]
    made += feed(assembler, [f for n, stamp in enumerate(stamps, 20) for f in cycle(HAND, n, stamp)])
    assert [one.sequence[0] for one in made] == list(range(40))
    assert assembler.counts.incomplete == 0
    assert assembler.counts.phalanges[0].drops == 0


def test_a_clock_step_within_a_cycle_costs_that_cycle() -> None:
    assembler = warm_up(CycleAssembler(HAND, WAIT_S), HAND)
    frames = [frame for n in range(5) for frame in cycle(HAND, n)]
    for frame in frames[9:]:
        frame.timestamp -= 60.0
    made = feed(assembler, frames)
    assert [one.status.tolist() == [OK, OK] for one in made].count(False) <= 2
    assert made[-1].sequence.tolist() == [4, 4]
    for one in made:
        assert_of_one_sample(one)


@pytest.mark.slow
def test_drifting_clocks_cost_few_samples() -> None:
    assembler = warm_up(CycleAssembler(HAND, WAIT_S), HAND)
    events = [(START_NS + n * PERIOD_NS, 0, n) for n in range(4000)]
    events += [(START_NS + 1_000_000 + int(n * PERIOD_NS * 1.001), 1, n) for n in range(3995)]
    made: list[Cycle] = []
    for stamp_ns, phalanx, n in sorted(events):
        made += assembler.flush(stamp_ns)
        made += feed(assembler, sample(HAND, phalanx, n, stamp_ns))
    slips = 4
    assert sum(one.status.tolist() == [OK, OK] for one in made) > 4000 - 60 * slips
    assert assembler.counts.frames[FrameKind.OUT_OF_ORDER] <= 20 * slips
    assert assembler.counts.phalanges[0].samples > 3995 - 10 * slips


def spread(number: int, pause_s: float = 0.0001) -> list[can.Message]:
    """A cycle whose frames come one after the other, as on a bus."""
    frames = cycle(HAND, number)
    for i, frame in enumerate(frames):
        frame.timestamp += i * pause_s
    return frames


@pytest.mark.parametrize("received", [1, 2, 3, 4])
def test_starting_within_a_cycle_joins_no_halves(received: int) -> None:
    assembler = CycleAssembler(HAND, wait_s=0.02)  # longer than the period: only the pause separates them
    made = feed(assembler, spread(0)[4 - received :] + [frame for n in range(1, 40) for frame in spread(n)])
    assert all(one.status.tolist() == [OK, OK] for one in made[15:])
    assert len(made) >= 39
    for one in made:
        assert_of_one_sample(one)


@pytest.mark.parametrize("every", [4, 10, 1000])
def test_pauses_of_a_sender_do_not_misalign(every: int) -> None:
    assembler = CycleAssembler(HAND, wait_s=0.03)
    made: list[Cycle] = []
    for n in range(300):
        frames = spread(n)
        if n in (1, 2, 3) or n % every == 0:
            for i, frame in enumerate(frames[2:]):
                frame.timestamp += 0.0047 - 0.0001 * i
        made += feed(assembler, frames)
    assert len(made) >= 299
    assert all(one.status.tolist() == [OK, OK] for one in made[100:])
    for one in made:
        assert_of_one_sample(one)


def test_delayed_frames_keep_the_alignment() -> None:
    assembler = warm_up(CycleAssembler(HAND, wait_s=0.02), HAND)
    made: list[Cycle] = []
    for n in range(200):
        made += feed(assembler, spread(n, 0.0001 if n % 4 else 0.0014))
    assert all(one.status.tolist() == [OK, OK] for one in made)


@pytest.mark.parametrize("jitter", [0.05, 1.0])
def test_without_pauses_only_one_load_cell_is_used(jitter: float) -> None:
    rng = np.random.default_rng(6)
    assembler = CycleAssembler(HAND, wait_s=0.02)
    now_s = START_NS * 1e-9
    made: list[Cycle] = []
    for n in range(400):
        frames = cycle(HAND, n)
        for frame in frames:
            now_s += 0.00125 * (1 - jitter + jitter * rng.exponential())
            frame.timestamp = now_s
        made += feed(assembler, frames)
    assert [one.status.tolist() for one in made] == [[OK, MISSING]] * len(made)
    assert assembler.aligned == [True, False]


def test_without_a_counter_time_separates_cycles(tmp_path: Path) -> None:
    plain = without_counter(tmp_path)
    assembler = CycleAssembler(plain, wait_s=0.02)  # four periods: the learned period must do
    rng = np.random.default_rng(4)
    lost, made = 0, []
    for n in range(600):
        frames = cycle(plain, n)
        if n > 20 and rng.random() < 0.2:
            del frames[rng.integers(4)]
            lost += 1
        for frame in frames:
            made += assembler.feed([frame])
    made += assembler.flush(START_NS + 10**12)
    assert len(made) == 600
    assert sum(MISSING in one.status for one in made[20:]) == lost
    for one in made:
        assert_of_one_sample(one)
    assert [one.sequence[0] for one in made if one.status[0] == OK][-1] >= 597


def test_saturation_and_faults_are_marked_by_phalanx() -> None:
    assembler = warm_up(CycleAssembler(HAND, WAIT_S), HAND)
    stamp_s = START_NS * 1e-9
    frames = HAND.encode(0, np.full(8, 9.9), 0, stamp_s=stamp_s)
    frames += HAND.encode(1, np.zeros(8), 0, status=1, stamp_s=stamp_s)
    (made,) = feed(assembler, frames)
    assert made.status.tolist() == [SATURATED, FAULT]
    assert assembler.counts.phalanges[0].saturated == 1
    assert assembler.counts.phalanges[1].faults == 1


def test_reset_forgets_the_counters() -> None:
    assembler = warm_up(CycleAssembler(HAND, WAIT_S), HAND)
    feed(assembler, cycle(HAND, 0) + cycle(HAND, 1)[:3])
    assembler.reset()
    assert assembler.aligned == [False, False]
    made = feed(assembler, [frame for n in range(11, 40) for frame in cycle(HAND, n)])
    assert [one.status.tolist() for one in made] == [[OK, MISSING]] * 11 + [[OK, OK]] * 19
    assert made[-1].sequence.tolist() == [39, 39]
    assert [p.gaps for p in assembler.counts.phalanges] == [0, 0]


def test_equal_counters_do_not_join_samples() -> None:
    """A load cell restarts with the counter value that it had, and each of the two samples is half lost."""
    assembler = warm_up(CycleAssembler(HAND, 0.02), HAND)
    first, second = sample(HAND, 0, 0), sample(HAND, 0, 16)
    frames = [first[0], *sample(HAND, 1, 0)[:1], second[0], second[1], *cycle(HAND, 1)]
    for one in feed(assembler, frames):
        assert_of_one_sample(one)


def assert_of_one_sample(made: Cycle) -> None:
    """What is there of a cycle is of one sample number, unaltered; what is missing is NaN."""
    numbers = set()
    for p, status in enumerate(made.status):
        strain = made.strain[8 * p : 8 * p + 8]
        if status & MISSING:
            assert np.isnan(strain).all()
        else:
            numbers.add(number_of(p, strain))
    assert len(numbers) <= 1


@given(
    seed=st.integers(0, 2**32 - 1),
    loss=st.sampled_from([0.0, 0.05, 0.3]),
    duplicates=st.sampled_from([0.0, 0.1]),
    garbage=st.sampled_from([0.0, 0.1]),
    batch=st.integers(1, 20),
)
def test_random_faults_never_mix_cycles(
    seed: int, loss: float, duplicates: float, garbage: float, batch: int
) -> None:
    rng = np.random.default_rng(seed)
    wire = cycle(HAND, 0)
    arrived, unique_sent = 4, 4 * (122 + CONFIRMATION)
    for n in range(1, 121):
        frames = cycle(HAND, n)
        for i in rng.permutation(4):
            if rng.random() < loss:
                continue
            arrived += 1
            wire += [frames[i]] * (1 + (rng.random() < duplicates))
            if rng.random() < garbage:
                wire.append(unknown_frame(rng, frames[i].timestamp))
    for n in range(121, 122 + CONFIRMATION):  # complete, so that the counters show everything lost before
        wire += cycle(HAND, n)
        arrived += 4

    assembler = warm_up(CycleAssembler(HAND, WAIT_S), HAND)
    made: list[Cycle] = []
    for i in range(0, len(wire), batch):
        made += assembler.feed(wire[i : i + batch])
    made += assembler.flush(START_NS + 10**12)

    for one in made:
        assert_of_one_sample(one)
        assert one.sequence[0] == one.sequence[1] or MISSING in one.status
    counts = assembler.counts
    assert sum(counts.frames) == len(wire)
    assert counts.frames[FrameKind.DATA] == arrived
    assert sum(p.drops for p in counts.phalanges) == unique_sent - arrived
    assert max(made[-1].sequence) >= 120


def unknown_frame(rng: np.random.Generator, stamp_s: float) -> can.Message:
    """A frame that is not in the DBC."""
    identifier = int(rng.integers(0x120, 0x7FF))
    data = rng.bytes(rng.integers(0, 9))
    return can.Message(arbitration_id=identifier, is_extended_id=False, data=data, timestamp=stamp_s)


def test_random_frames_are_counted() -> None:
    """Fuzz: random identifiers, flags, lengths, bytes and stamps, between good cycles."""
    rng = np.random.default_rng(5)
    assembler = warm_up(CycleAssembler(HAND, WAIT_S), HAND)
    known = [message.key for message in HAND.messages]
    good = 0
    for n in range(10):
        count = 2_000
        key = rng.integers(0, 2**32, count, dtype=np.uint32)
        key[::2] = rng.choice(known, count // 2)  # every other one looks like a load cell's
        length = np.where(rng.random(count) < 0.5, 8, rng.integers(0, 65, count))
        stamps = rng.uniform(-(2**62), 2**62, count) * 1e-9
        frames = [
            can.Message(
                timestamp=stamp,
                arbitration_id=one & 0x1FFFFFFF,
                is_extended_id=bool(one >> 31),
                is_remote_frame=bool(one >> 30 & 1),
                is_error_frame=bool(one >> 29 & 1),
                data=rng.bytes(size),
            )
            for one, stamp, size in zip(key.tolist(), stamps.tolist(), length.tolist(), strict=True)
        ]
        for one in assembler.feed(frames):
            assert len(one.strain) == 16
        assert sum(assembler.counts.frames) == (n + 1) * count + good
        for number in range(60 * n, 60 * n + 60):
            made = feed(assembler, cycle(HAND, number))
            good += 4
        assert made[-1].status.tolist() == [OK, OK]
        assert number_of(0, made[-1].strain[:8]) == (60 * n + 59) % 1000
    assert good == 10 * 240
