"""Transforms are looked up along the frames between two, as tf2 does."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from tactile_localizer.core.geometry.transforms import Transform, look_up

MS = 1_000_000
STAMPS_NS = np.arange(0, 200, 7) * MS


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
    arm, of_arm = random_link(rng, "base", "arm", [0, 50, 90, 130, 200])
    palm, of_palm = random_link(rng, "arm", "palm", [0, 60, 200])
    table, of_table = random_link(rng, "base", "table", [0, 200])
    fixture, of_fixture = random_link(rng, "table", "fixture", [0])
    moving = [*palm, *arm, *table]
    rng.shuffle(moving)  # the order of receipt does not matter
    moving = [Transform(*one) for one in moving]
    poses, found = look_up(fixture, moving, "fixture", "palm", STAMPS_NS, 1.0)
    expected = np.linalg.inv(of_table @ of_fixture) @ of_arm @ of_palm
    np.testing.assert_allclose(poses, expected, atol=1e-12)
    assert found.all()


def line(*stamps_ms, parent="base", child="palm", w=1.0):
    return [Transform(parent, child, ms * MS, (ms, 0.0, 0.0, 0.0, 0.0, 0.0, w)) for ms in stamps_ms]


def found_at(moving, *stamps_ms, target="base", source="palm", static=()):
    poses, found = look_up(static, moving, target, source, np.array(stamps_ms) * MS, 0.1)
    return [round(x) if ok else None for x, ok in zip(poses[:, 0, 3].tolist(), found.tolist(), strict=True)]


def test_nothing_is_found_outside_of_the_transforms_or_in_a_gap():
    assert found_at(line(10, 110, 211), 9, 10, 60, 110, 150, 211, 212) == [None, 10, 60, 110, None, 211, None]


def test_frames_that_are_not_connected_are_not_found():
    assert found_at(line(10, 20), 15, source="tool") == [None]
    assert found_at(line(10, 20, parent="a", child="b") + line(10, 20, parent="b", child="a"), 15) == [None]
    assert found_at(line(10, 20), 15, source="base") == [0]


@pytest.mark.parametrize("w", [np.nan, 0.9, 0.0])
def test_transforms_that_tf2_ignores_are_ignored(w):
    assert found_at(line(10, 20) + line(15, w=w), 15) == [15]


def test_static_transforms_always_hold():
    assert found_at(line(10, 20), 15, source="tip", static=line(3, parent="palm", child="tip")) == [18]


def test_of_equal_stamps_the_first_counts_and_slashes_do_not():
    other = [each._replace(pose=(99.0, *each.pose[1:])) for each in line(10)]
    assert found_at([*line(10, 20, parent="/base", child="/palm"), *other], 10) == [10]
