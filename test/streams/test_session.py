"""A session gives pairs by sweep, whichever topic is late, and the same when it is live or recorded."""

import math
import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_localizer.scene import Axis
from tactile_localizer.streams.session import Session
from tactile_localizer.streams.sweep_detector import NO_SWEEP, SweepDetector
from tactile_localizer.streams.synchronization import interpolate_poses

AXES = (Axis("x", 0.0, 1.0),)
MS = 1_000_000


def summary(pairs):
    return [(p.stamp_ns // MS, None if p.position is None else round(float(p.position[0]), 6)) for p in pairs]


def pose(session, stamp_ms, x):
    session.add_pose(stamp_ms * MS, np.array([x]))
    return summary(session.take())


def strain(session, stamp_ms):
    session.add_strain(stamp_ms * MS, None)
    return summary(session.take())


def test_a_strain_vector_waits_for_the_pose_that_follows_it():
    session = Session(AXES)
    assert pose(session, 100, 0.1) == []
    assert strain(session, 105) == []
    assert strain(session, 115) == []
    assert session.settled == (0, 105 * MS - 1)
    assert session.newest_input_ns == session.newest_ns == 115 * MS
    assert pose(session, 110, 0.2) == [(105, 0.15)]
    assert pose(session, 120, 0.3) == [(115, 0.25)]
    assert session.settled == (0, 115 * MS)
    assert session.newest_input_ns == session.newest_pose_ns == 120 * MS


def test_patience_is_measured_by_stamps():
    session = Session(AXES, patience_s=0.1)
    pose(session, 100, 0.1)
    assert strain(session, 150) == []
    assert strain(session, 250) == []
    assert strain(session, 251) == [(150, None)]
    assert summary(session.finish()) == [(250, None), (251, None)]


def test_a_clock_that_is_set_forward_ends_no_patience():
    """With either topic 300 ms behind the other one. Strain slower than the patience is no such clock."""
    stamps_ms = [*range(1000, 2000, 10), *range(60_000, 61_000, 10)]
    for late in (strain, pose):
        session, found = Session(AXES), []
        for at in range(len(stamps_ms) + 30):
            places = {strain: (), pose: (0.5,)}
            for topic, place in places.items():
                if 0 <= (row := at - 30 * (topic is late)) < len(stamps_ms):
                    found += topic(session, stamps_ms[row], *place)
        assert found == [(ms, 0.5) for ms in stamps_ms]
    session = Session(AXES, patience_s=0.1)
    assert [strain(session, stamp_ms) for stamp_ms in (1000, 3000, 5000)] == [
        [],
        [],
        [(1000, None), (3000, None)],
    ]


@pytest.mark.parametrize(("count", "every_ms"), [(10, 1600), (2, 1500), (1, 2000)])
def test_strain_in_bursts_waits_no_longer_for_poses_that_have_stopped(count, every_ms):
    session, oldest_ms, begin_ms = Session(AXES), [], 5000
    pose(session, begin_ms, 0.0)
    for burst in range(300):
        for n in range(count):
            now_ms = begin_ms + every_ms * burst + 10 * n
            oldest_ms += [now_ms - ms for ms, _ in strain(session, now_ms)]
    assert max(oldest_ms) <= 1000 + 2 * every_ms
    assert session.waiting <= 2 * count


def test_late_strain_is_paired_where_it_was_felt():
    session = Session(AXES, delay_s=0.005)
    pose(session, 100, 0.1)
    assert strain(session, 107) == []
    assert pose(session, 110, 0.2) == [(102, 0.12)]
    assert (session.newest_ns, session.newest_pose_ns) == (102 * MS, 110 * MS)


def test_late_messages_are_dropped_and_counted():
    session = Session(AXES)
    pose(session, 100, 0.1)
    pose(session, 110, 0.2)
    assert pose(session, 105, 0.9) == []
    assert strain(session, 106) == [(106, 0.16)]
    assert strain(session, 104) == []
    assert session.late == 2


def test_poses_are_kept_while_a_strain_vector_may_need_them_and_not_for_longer():
    session = Session(AXES, patience_s=0.5, max_gap_s=0.1)
    tracemalloc.start()
    sizes = []
    for step in range(10_000):
        pose(session, 10 * step, 0.5)
        if step % 1000 == 999:
            sizes.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    assert max(sizes[1:]) < sizes[0] + 20_000
    for last in range(300, 500, 7):  # in any phase of the deletion
        session = Session(AXES, patience_s=0.5, max_gap_s=0.1)
        for step in range(last):
            pose(session, 10 * step, 0.5)
        assert strain(session, 10 * step - 1000) == [(10 * step - 1000, 0.5)]


@pytest.mark.parametrize("first", ["pose", "strain"])
def test_a_backward_jump_of_either_topic_resets(first):
    session = Session(AXES)
    pose(session, 100_000, 0.1)
    strain(session, 100_001)
    if first == "pose":
        assert pose(session, 100, 0.5) == [(100_001, None)]
        assert strain(session, 105) == []
    else:
        assert strain(session, 105) == [], "a pose from before the jump may follow"
        assert pose(session, 100, 0.5) == [(100_001, None)]
    assert pose(session, 110, 0.7) == [(105, 0.6)]
    assert session.resets == 1


@given(
    order=st.permutations(["pose"] * 12 + ["strain"] * 15),
    pose_steps=st.lists(st.integers(1, 150), min_size=12, max_size=12),
    strain_steps=st.lists(st.integers(1, 100), min_size=15, max_size=15),
)
def test_pairs_do_not_depend_on_the_order_of_arrival(order, pose_steps, strain_steps):
    pose_ms, strain_ms = np.cumsum(pose_steps), np.cumsum(strain_steps)
    x = np.random.default_rng(0).uniform(0, 1, len(pose_ms))
    session = Session(AXES, patience_s=10.0)
    poses, strains = iter(zip(pose_ms.tolist(), x, strict=True)), iter(strain_ms.tolist())
    pairs = []
    for kind in order:
        pairs += pose(session, *next(poses)) if kind == "pose" else strain(session, next(strains))
    pairs += summary(session.finish())
    expected, found = interpolate_poses(AXES, pose_ms * MS, x[:, None], strain_ms * MS)
    places = [
        round(float(each), 6) if known else None for (each,), known in zip(expected, found, strict=True)
    ]
    assert pairs == list(zip(strain_ms.tolist(), places, strict=True))


def test_a_pair_keeps_its_position_whatever_becomes_of_the_array_of_the_pose():
    session, place = Session(AXES), np.array([0.1])
    session.add_pose(10 * MS, place)
    session.add_strain(10 * MS, 0)
    (pair,) = session.take()
    place[0] = 0.9
    np.testing.assert_array_equal(pair.position, [0.1])


def streams(rng):
    """Stamps of strain and poses, and times of arrival: jumps, silence, late, repeated and missing ones."""
    begin, stamp, stamps, arrivals = 0, 50_000, ([], []), ([], [])
    for _ in range(rng.integers(1, 5)):
        silence = rng.integers(0, 5000)
        begin, stamp = (
            begin + silence,
            stamp + rng.choice([2500 + silence, rng.integers(3500, 60_000), -rng.integers(0, 5000)]),
        )
        for topic, period in ((0, 7), (1, 10)):
            times = np.arange(rng.integers(0, 300), 2500, period)
            times = np.repeat(times, rng.choice([0, 1, 2], len(times), p=[0.02, 0.96, 0.02]))
            delay = rng.integers(0, 400)  # ms
            late = np.where(rng.random(len(times)) < 0.05, rng.integers(0, 100, len(times)), 0)
            order = np.argsort(times + late, kind="stable")
            stamps[topic].extend(stamp + times[order])
            arrivals[topic].extend(np.sort(begin + times + late) + delay)
        begin += 2500
    return [np.array(each) * MS for each in stamps], [np.maximum.accumulate(each) for each in arrivals]


def fed(session, strain_ns, pose_ns, x, order, take, begins=()):
    """Pairs of a session in which strain (n) and poses (m) arrive in an order, (n + m) of their rows.

    Sweeps begin at rows, ``begins``, of the strain; a recording gets its marks at the end.
    """
    pairs, marks = [], []
    for at in order.tolist():
        if at < len(strain_ns):
            session.add_strain(int(strain_ns[at]), at)
            if at in begins:
                marks.append((session.run, session.newest_ns, at))
        else:
            session.add_pose(int(pose_ns[at - len(strain_ns)]), x[at - len(strain_ns)])
        pairs += take(session)
        if marks and take is Session.take:
            session.mark(*marks.pop())
    for mark in marks:
        session.mark(*mark)
    return pairs + session.finish()


def require_same(pairs, others):
    assert [(pair.measurement, pair.run, pair.sweep) for pair in pairs] == [
        (pair.measurement, pair.run, pair.sweep) for pair in others
    ]
    places = [[np.nan if p.position is None else p.position[0] for p in each] for each in (pairs, others)]
    np.testing.assert_array_equal(*places)


@given(st.integers(0, 2**32), st.sampled_from([0.0, 0.07, -0.05]), st.booleans())
def test_a_recorded_session_is_the_live_one_whatever_the_order_of_arrival(seed, delay_s, is_detected):
    """Jumps included, whichever topic jumps first; its sweeps, too, by marks or detected."""
    rng = np.random.default_rng(seed)

    def session(**how):
        return Session(AXES, delay_s=delay_s, detector=SweepDetector(AXES) if is_detected else None, **how)

    (strain_ns, pose_ns), (strain_at, pose_at) = streams(rng)
    x = 0.5 + 0.1 * np.sin(pose_ns[:, None] / (300 * MS))
    begins = {*rng.choice(len(strain_ns), 4).tolist()}
    order, other = (
        np.argsort(np.concatenate([strain_at + apart, pose_at]), kind="stable")
        for apart in (0, rng.integers(-200, 200))
    )
    live = fed(session(), strain_ns, pose_ns, x, order, Session.take, begins)
    for arrived in (order, other):
        recorded = session(patience_s=math.inf)
        require_same(fed(recorded, strain_ns, pose_ns, x, arrived, lambda session: [], begins), live)
    assert recorded.run == np.count_nonzero(np.diff(strain_ns) < -500 * MS)


def test_a_topic_that_does_not_jump_is_taken_along():
    """As when the clock of one of two computers is set right."""
    pose_ns = np.arange(0, 10_000, 10) * MS
    strain_ns = np.concatenate([np.arange(3_600_000, 3_605_000, 10), np.arange(5000, 9900, 10)]) * MS
    x = pose_ns[:, None] * 1e-12
    order = np.argsort(np.concatenate([np.arange(len(strain_ns)) + 0.5, np.arange(1000)]))
    live = fed(Session(AXES), strain_ns, pose_ns, x, order, Session.take)
    require_same(
        fed(Session(AXES, patience_s=math.inf), strain_ns, pose_ns, x, order, lambda session: []), live
    )
    found = [[pair.position is not None for pair in live if pair.run == run] for run in (0, 1)]
    assert not any(found[0])
    assert np.mean(found[1]) > 0.7


def test_a_jump_of_the_poses_alone_begins_no_run_of_the_strain():
    session = Session(AXES)
    for ms in range(5000, 9000, 10):
        session.add_strain(ms * MS, None)
        session.add_pose((ms if ms < 7000 else ms - 5000) * MS, np.array([0.1]))
    assert session.runs.jumps == [0, 1]
    assert {pair.run for pair in session.finish()} == {0}


def sweeps_of(session):
    return [(pair.run, pair.stamp_ns // MS, pair.sweep) for pair in session.finish()]


def test_a_sweep_holds_what_is_stamped_between_its_marks_whenever_it_arrives():
    session = Session(AXES)
    for stamp_ms in (1, 2, 3):
        session.add_strain(stamp_ms * MS, None)
    for after_ms in (3, 4, 5):
        session.mark(0, after_ms * MS, 7)
    session.mark(0, 2 * MS, 8)  # from before those that it replaces
    session.mark(0, 5 * MS, NO_SWEEP)
    for stamp_ms in (4, 5, 6):
        session.add_strain(stamp_ms * MS, None)
    outside, inside = NO_SWEEP, 8
    assert sweeps_of(session) == [
        (0, 1, outside),
        (0, 2, outside),
        *((0, ms, inside) for ms in (3, 4, 5)),
        (0, 6, outside),
    ]


def test_a_mark_holds_in_the_runs_after_it():
    session = Session(AXES)
    session.mark(0, 1000 * MS, 3)
    session.add_strain(2000 * MS, None)
    session.add_strain(10 * MS, None)
    session.mark(session.run, 10 * MS, NO_SWEEP)
    session.add_strain(20 * MS, None)
    assert sweeps_of(session) == [(0, 2000, 3), (1, 10, 3), (1, 20, NO_SWEEP)]


def test_a_detected_sweep_ends_where_time_jumps_back():
    session = Session(AXES, detector=SweepDetector(AXES))
    for run, begin_ms in ((0, 5000), (1, 0)):
        for ms in range(begin_ms, begin_ms + 1000, 10):
            session.add_pose(ms * MS, np.array([(ms - begin_ms) * 1e-5]))
            session.add_strain(ms * MS, run)
    pairs = session.finish()
    assert [{pair.sweep for pair in pairs if pair.run == run} for run in (0, 1)] == [
        {NO_SWEEP, 1},
        {NO_SWEEP, 2},
    ]
