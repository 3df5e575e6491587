"""Transforms are looked up along the frames between two, as tf2 does."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from tactile_localizer.streams.transforms import Transform, combined

MS = 1_000_000
STAMPS_NS = np.arange(0, 204, 7) * MS


def matrices(place, turn):
    made = np.tile(np.eye(4), (len(place), 1, 1))
    made[:, :3, :3], made[:, :3, 3] = turn.as_matrix(), place
    return made


def random_link(rng, parent, child, stamps_ms):
    """Transforms at stamps, and their matrices at :data:`STAMPS_NS`."""
    at, places = STAMPS_NS / MS, rng.normal(size=(len(stamps_ms), 3))
    turns = Rotation.from_rotvec(rng.normal(size=(len(stamps_ms), 3)))
    numbers = np.hstack([places, turns.as_quat()]).tolist()
    link = [Transform(parent, child, ms * MS, tuple(n)) for ms, n in zip(stamps_ms, numbers, strict=True)]
    if len(stamps_ms) == 1:
        return link, matrices(np.repeat(places, len(at), axis=0), turns[np.zeros(len(at), dtype=int)])
    place = np.stack([np.interp(at, stamps_ms, column) for column in places.T], axis=1)
    return link, matrices(place, Slerp(stamps_ms, turns)(at))


def test_frames_are_followed_up_and_down_the_tree():
    rng = np.random.default_rng(0)
    arm, of_arm = random_link(rng, "base", "arm", [0, 49, 91, 133, 203])
    palm, of_palm = random_link(rng, "arm", "palm", [0, 63, 203])
    table, of_table = random_link(rng, "base", "table", [0, 203])
    fixture, of_fixture = random_link(rng, "table", "fixture", [0])
    lamp, _ = random_link(rng, "base", "lamp", [0, 203])
    moving = [*palm[:-1], *table, *lamp]
    messages = [[each] for each in moving] + [[each] for each in arm] + [palm[-1:]]
    rows, stamp_ns, poses = combined(fixture, messages, "fixture", "palm")
    assert (stamp_ns // MS).tolist() == [49, 63, 203], "the oldest of the newest"
    assert rows.tolist() == [len(moving) + 1, len(moving) + 2, len(messages) - 1]
    expected = np.linalg.inv(of_table @ of_fixture) @ of_arm @ of_palm
    np.testing.assert_allclose(poses, expected[np.searchsorted(STAMPS_NS, stamp_ns)], atol=1e-12)


def line(*stamps_ms, parent="base", child="palm", w=1.0):
    return [[Transform(parent, child, ms * MS, (ms, 0.0, 0.0, 0.0, 0.0, 0.0, w))] for ms in stamps_ms]


def places(messages, target="base", source="palm", static=()):
    """Stamp (ms) and x of each pose."""
    _, stamp_ns, poses = combined([each for message in static for each in message], messages, target, source)
    return list(zip((stamp_ns // MS).tolist(), poses[:, 0, 3].round(6).tolist(), strict=True))


def test_each_newer_transform_gives_a_pose_and_late_ones_none():
    assert places(line(10, 30, 20, 30, 40)) == [(10, 10), (30, 30), (40, 40)]


def test_frames_that_are_not_connected_give_no_pose():
    assert places(line(10, 20), source="tool") == []
    assert places(line(10, 20, parent="a", child="b") + line(10, 20, parent="b", child="a")) == []
    assert places(line(10, 20), source="base") == []
    assert places([], static=line(10)) == [], "nothing moves"


@pytest.mark.parametrize("w", [np.nan, 0.9, 0.0])
def test_transforms_that_tf2_ignores_are_ignored(w):
    assert places([*line(10), *line(15, w=w), *line(20)]) == [(10, 10), (20, 20)]


def test_static_transforms_always_hold():
    static = line(2, 3, parent="palm", child="tip")
    assert places(line(10, 20), source="tip", static=static) == [(10, 13), (20, 23)]


def test_transforms_from_before_a_jump_are_forgotten():
    arm = line(5000, 100, 200, parent="base", child="arm")
    palm = line(5000, 100, 200, parent="arm", child="palm")
    messages = [message for pair in zip(arm, palm, strict=True) for message in pair]
    assert places(messages) == [(5000, 10_000), (100, 200), (200, 400)]
