"""Palm positions are interpolated at the stamps of strain vectors, whichever topic is late."""

import math
import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_localizer.scene import Axis
from tactile_localizer.streams.runs import LATE, runs_of
from tactile_localizer.streams.synchronization import (
    Pairing,
    clock_difference_s,
    describe_gaps,
    interpolate_poses,
    near_bounds,
    pair_recorded,
)

AXES = (Axis("x", 0.0, 1.0),)
MS = 1_000_000


def interpolated(axes, poses, *stamps_ms):
    pose_ns = np.array([round(stamp_s * 1e9) for stamp_s, _ in poses], dtype=np.int64)
    positions = np.array([position for _, position in poses], dtype=float).reshape(-1, len(axes))
    return interpolate_poses(axes, pose_ns, positions, np.array(stamps_ms) * MS)[0]


def test_yaw_follows_the_shortest_arc_near_its_bounds():
    poses = [(1.0, (3.1,)), (1.1, (-3.1,))]
    yaw, beyond = Axis("yaw", -math.pi, math.pi), Axis("yaw", 3.0, 3.5)
    np.testing.assert_allclose(np.abs(interpolated((yaw,), poses, 1050)), math.pi)
    np.testing.assert_allclose(interpolated((beyond,), poses, 1100), math.tau - 3.1)


def test_no_position_outside_the_poses_or_in_a_gap_but_at_its_ends():
    poses = [(1.0, (0.1,)), (1.1, (0.2,)), (1.3, (0.4,))]
    found = interpolated(AXES, poses, 999, 1000, 1050, 1100, 1200, 1300, 1301)[:, 0]
    np.testing.assert_allclose(found, [math.nan, 0.1, 0.15, 0.2, math.nan, 0.4, math.nan])
    assert np.isnan(interpolated(AXES, [], 1000)).all()


def test_near_bounds_moves_yaw_by_whole_turns():
    axes = (*AXES, Axis("yaw", -0.5, 0.5))
    given_positions = np.array([[0.1, 6.0], [0.2, -6.5], [0.3, 0.4]])
    moved = near_bounds(axes, given_positions)
    np.testing.assert_allclose(moved[:, 1], [6.0 - math.tau, -6.5 + math.tau, 0.4])
    np.testing.assert_array_equal(given_positions[:, 1], [6.0, -6.5, 0.4])
    assert near_bounds(AXES, given_positions) is given_positions


def summary(pairs):
    return [(p.stamp_ns // MS, None if p.position is None else round(float(p.position[0]), 6)) for p in pairs]


def pose(pairing, stamp_ms, x):
    return summary(pairing.add_pose(stamp_ms * MS, np.array([x])))


def strain(pairing, stamp_ms):
    return summary(pairing.add_strain(stamp_ms * MS, None))


def test_a_strain_vector_waits_for_the_pose_that_follows_it():
    pairing = Pairing(AXES)
    assert pose(pairing, 100, 0.1) == []
    assert strain(pairing, 105) == []
    assert strain(pairing, 115) == []
    assert pairing.settled_ns == 105 * MS - 1
    assert pairing.newest_input_ns == pairing.newest_ns == 115 * MS
    assert pose(pairing, 110, 0.2) == [(105, 0.15)]
    assert pose(pairing, 120, 0.3) == [(115, 0.25)]
    assert pairing.settled_ns == 115 * MS
    assert pairing.newest_input_ns == pairing.newest_pose_ns == 120 * MS


def test_patience_is_measured_by_stamps():
    pairing = Pairing(AXES, patience_s=0.1)
    pose(pairing, 100, 0.1)
    assert strain(pairing, 150) == []
    assert strain(pairing, 250) == []
    assert strain(pairing, 251) == [(150, None)]
    assert summary(pairing.finish()) == [(250, None), (251, None)]


def test_late_messages_are_dropped_and_counted():
    pairing = Pairing(AXES)
    pose(pairing, 100, 0.1)
    pose(pairing, 110, 0.2)
    assert pose(pairing, 105, 0.9) == []
    assert strain(pairing, 106) == [(106, 0.16)]
    assert strain(pairing, 104) == []
    assert pairing.late == 2


def test_poses_are_kept_while_a_strain_vector_may_need_them_and_not_for_longer():
    pairing = Pairing(AXES, patience_s=0.5, max_gap_s=0.1)
    tracemalloc.start()
    sizes = []
    for step in range(10_000):
        pose(pairing, 10 * step, 0.5)
        if step % 1000 == 999:
            sizes.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    assert max(sizes[1:]) < sizes[0] + 20_000
    for last in range(300, 500, 7):  # in any phase of the deletion
        pairing = Pairing(AXES, patience_s=0.5, max_gap_s=0.1)
        for step in range(last):
            pose(pairing, 10 * step, 0.5)
        assert strain(pairing, 10 * step - 1000) == [(10 * step - 1000, 0.5)]


@pytest.mark.parametrize("first", ["pose", "strain"])
def test_a_backward_jump_of_either_topic_resets(first):
    pairing = Pairing(AXES)
    pose(pairing, 100_000, 0.1)
    strain(pairing, 100_001)
    if first == "pose":
        assert pose(pairing, 100, 0.5) == [(100_001, None)]
        assert strain(pairing, 105) == []
    else:
        assert strain(pairing, 105) == [], "a pose from before the jump may follow"
        assert pose(pairing, 100, 0.5) == [(100_001, None)]
    assert pose(pairing, 110, 0.7) == [(105, 0.6)]
    assert pairing.resets == 1


@given(
    order=st.permutations(["pose"] * 12 + ["strain"] * 15),
    pose_steps=st.lists(st.integers(1, 150), min_size=12, max_size=12),
    strain_steps=st.lists(st.integers(1, 100), min_size=15, max_size=15),
)
def test_pairs_do_not_depend_on_the_order_of_arrival(order, pose_steps, strain_steps):
    pose_ms, strain_ms = np.cumsum(pose_steps), np.cumsum(strain_steps)
    x = np.random.default_rng(0).uniform(0, 1, len(pose_ms))
    pairing = Pairing(AXES, patience_s=10.0)
    waiting = {"pose": list(zip(pose_ms, x, strict=True)), "strain": list(strain_ms)}
    pairs = []
    for kind in order:
        if kind == "pose":
            stamp, value = waiting["pose"].pop(0)
            pairs += pairing.add_pose(int(stamp) * MS, np.array([value]))
        else:
            pairs += pairing.add_strain(int(waiting["strain"].pop(0)) * MS, None)
    pairs += pairing.finish()
    expected, found = interpolate_poses(AXES, pose_ms * MS, x[:, None], strain_ms * MS)
    assert [pair.stamp_ns for pair in pairs] == list(strain_ms * MS)
    assert [pair.position is not None for pair in pairs] == list(found)
    for pair, position in zip(pairs, expected, strict=True):
        if pair.position is not None:
            np.testing.assert_array_equal(pair.position, position)


def test_a_stamp_is_late_by_half_a_second_at_most():
    seconds = np.array([0.0, 1.0, 1.0, 0.5, 1.2, 0.6999, 0.8, 0.2, 0.3])
    np.testing.assert_array_equal(runs_of((seconds * 1e9).astype(int)), [0, 0, LATE, LATE, 0, 1, 1, 2, 2])


def streams(rng):
    """Stamps of strain and poses, and the times of their arrival: backward jumps, silence, late messages."""
    begin, stamp, stamps, arrivals = 0, 50_000, ([], []), ([], [])
    for _ in range(rng.integers(1, 5)):
        silence = rng.integers(0, 5000)
        begin, stamp = begin + silence, stamp + rng.choice([2500 + silence, -rng.integers(0, 5000)])
        for topic, period in ((0, 7), (1, 10)):
            times = np.arange(rng.integers(0, 300), 2500, period)
            times = times[rng.random(len(times)) > 0.02]
            delay = rng.integers(0, 400)  # ms
            late = np.where(rng.random(len(times)) < 0.05, rng.integers(0, 100, len(times)), 0)
            order = np.argsort(times + late, kind="stable")
            stamps[topic].extend(stamp + times[order])
            arrivals[topic].extend(np.sort(begin + times + late) + delay)
        begin += 2500
    return [np.array(each) * MS for each in stamps], [np.maximum.accumulate(each) for each in arrivals]


@given(st.integers(0, 2**32))
def test_pairs_of_a_recording_are_those_of_another_order_of_arrival(seed):
    """Jumps included, whichever topic jumps first."""
    rng = np.random.default_rng(seed)
    (strain_ns, pose_ns), (strain_at, pose_at) = streams(rng)
    x = rng.random((len(pose_ns), 1))
    pairing, live = Pairing(AXES), []
    for at in np.argsort(np.concatenate([strain_at, pose_at]), kind="stable"):
        if at < len(strain_ns):
            live += pairing.add_strain(int(strain_ns[at]), at)
        else:
            live += pairing.add_pose(int(pose_ns[at - len(strain_ns)]), x[at - len(strain_ns)])
    live += pairing.finish()
    order = np.searchsorted(strain_at + rng.integers(-200, 200), pose_at)
    for strain_before in (order, None):
        positions, found, sweep = pair_recorded(AXES, strain_ns, pose_ns, x, strain_before=strain_before)
        kept = np.flatnonzero(sweep != LATE)
        np.testing.assert_array_equal(found[kept], [pair.position is not None for pair in live])
        np.testing.assert_array_equal([pair.measurement for pair in live], kept)
        paired = [pair.position for pair in live if pair.position is not None]
        np.testing.assert_array_equal(positions[found], np.reshape(paired, (-1, 1)))
        assert sweep.max() == np.count_nonzero(np.diff(strain_ns) < -500 * MS)


def test_a_topic_that_does_not_jump_is_taken_along():
    """As when the clock of one of two computers is set right."""
    pose_ns = np.arange(0, 10_000, 10) * MS
    strain_ns = np.concatenate([np.arange(3_600_000, 3_605_000, 10), np.arange(5000, 9900, 10)]) * MS
    poses, before = pose_ns[:, None] * 1e-12, np.arange(1000)
    pairing, live = Pairing(AXES), []
    for number, at in enumerate(pose_ns.tolist()):
        live += pairing.add_pose(at, poses[number])
        live += pairing.add_strain(int(strain_ns[number]), None) if number < len(strain_ns) else []
    _, found, sweep = pair_recorded(AXES, strain_ns, pose_ns, poses, strain_before=before)
    np.testing.assert_array_equal(found, [pair.position is not None for pair in live + pairing.finish()])
    assert found[sweep == 1].mean() > 0.7
    assert not found[sweep == 0].any()


def gaps(strain_s, pose_s):
    stamps = (np.rint(np.multiply(each, 1e9)).astype(int) for each in (strain_s, pose_s))
    return describe_gaps(*stamps, 0.1)


def test_another_clock_is_named_with_both_ranges():
    assert gaps([5.0, 6.5], [1005.0, 1006.5]) == (
        "the poses are 1000 s ahead of the strain, another clock? strain from 5.000 to 6.500 s, "
        "poses from 1005.000 to 1006.500 s"
    )
    assert gaps([7.0, 8.0], [3.9]).startswith("the poses are 3.6 s behind the strain")
    assert gaps([7.0, 8.0], [6.95, 7.0]) == ""


@pytest.mark.parametrize("hours", [1.0, -1.0, 5.75, -9.5])
@pytest.mark.parametrize("length_s", [12.0, 12_000.0])
def test_the_difference_of_two_time_zones_is_exact(hours, length_s):
    strain_s = np.arange(0.02, length_s, 0.02)
    pose_s = np.arange(-0.3, length_s, 0.04) + 3600 * hours
    way = "ahead of" if hours > 0 else "behind"
    expected = f"the poses are {abs(3600 * hours):g} s {way} the strain, another time zone?"
    assert gaps(strain_s, pose_s).startswith(expected)


def test_another_difference_of_clocks_does_not_depend_on_a_late_begin():
    strain_s, pose_s = np.arange(0.0, 12.0, 0.02), np.arange(0.0, 12.0, 0.04) + 1234.5
    stamps = [np.rint(1e9 * each).astype(int) for each in (np.delete(strain_s, range(1, 50)), pose_s)]
    assert clock_difference_s(*stamps) == pytest.approx(1234.5, abs=0.5)
    assert (
        clock_difference_s(*[np.rint(1e9 * each).astype(int) for each in (strain_s, strain_s + 3.0)]) == 0.0
    )


def test_slow_poses_are_named_with_the_option():
    assert "the poses are 0.2 s apart" in gaps([0.0, 1.0], np.arange(0.0, 1.0, 0.2))
    assert "--max-gap 0.3" in gaps([0.0, 1.0], np.arange(0.0, 1.0, 0.2))
