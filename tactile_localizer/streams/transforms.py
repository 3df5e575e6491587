"""Transforms between frames over time, as tf2 combines them."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from tactile_localizer.quantity import LARGEST_NUMBER
from tactile_localizer.streams.runs import NANOSECONDS
from tactile_localizer.streams.synchronization import brackets

_UNIT_TOLERANCE = 0.01
"""Largest difference of a quaternion's squared length to 1; tf2 ignores others."""
_REWIND_NS = NANOSECONDS
"""Backward jump of the stamps of a frame after which earlier transforms are forgotten, ns, as live."""


_ALWAYS = -1
"""In place of the stamp of a static transform."""
_ANY_GAP_S = 1e9
"""s between two transforms across which tf2 interpolates; poses too far apart are no pair."""
_Poses = dict[int, tuple[float, ...]]
"""Poses of a frame in its parent by stamp, ns."""


class Transform(NamedTuple):
    """Pose of frame ``child`` in its parent: x, y, z (m) and a quaternion x, y, z, w."""

    parent: str
    child: str
    stamp_ns: int
    pose: tuple[float, ...]

    @property
    def is_valid(self) -> bool:
        """Whether tf2 takes the transform in."""
        pose = np.array(self.pose)
        return bool(
            (np.abs(pose) <= LARGEST_NUMBER).all() and abs(pose[3:] @ pose[3:] - 1.0) < _UNIT_TOLERANCE
        )


def combined(
    static: Sequence[Transform], messages: Sequence[Sequence[Transform]], target: str, source: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Poses of frame ``source`` in ``target``, one whenever all transforms between them are newer.

    Parameters
    ----------
    static : transforms of ``/tf_static``, which always hold
    messages : transforms of the messages of ``/tf``, in the order of arrival

    Returns
    -------
    rows : (m,) numbers of the messages that complete a pose; none do where the frames are not connected
    stamp_ns : (m,) the oldest of the newest stamps of the transforms, ns
    poses : (m, 4, 4) homogeneous matrices
    """
    parents = {each.child: each.parent for message in (*messages, static) for each in message}
    upwards, downwards = _line(parents, source), _line(parents, target)
    between = {*upwards} ^ {*downwards} if upwards[-1] == downwards[-1] else set()
    held = {each.child: {_ALWAYS: each.pose} for each in static if each.is_valid}
    moving = between - held.keys()
    newest: dict[str, int] = {}
    parts: list[tuple[dict[str, _Poses], list[tuple[int, int]]]] = []  # between jumps: poses, completions
    common_ns = 0
    for row, message in enumerate(messages):
        for each in message:
            if each.child in moving and each.is_valid:
                if not parts or each.stamp_ns < newest.get(each.child, 0) - _REWIND_NS:
                    newest, common_ns = {}, 0
                    parts.append(({frame: {} for frame in moving}, []))
                parts[-1][0][each.child].setdefault(each.stamp_ns, each.pose)
                newest[each.child] = max(each.stamp_ns, newest.get(each.child, 0))
        if moving and len(newest) == len(moving) and min(newest.values()) > common_ns:
            common_ns = min(newest.values())
            parts[-1][1].append((row, common_ns))
    found = [(np.zeros(0, dtype=int), np.zeros(0, dtype=int), np.zeros((0, 4, 4)))]
    for known, completions in parts:
        rows, stamp_ns = np.reshape(completions, (-1, 2)).astype(int).T
        of, to = (
            _in_common([frame for frame in line if frame in between], {**known, **held}, stamp_ns)
            for line in (upwards, downwards)
        )
        pose = np.linalg.solve(to, of)
        is_known = np.isfinite(pose).all(axis=(1, 2))
        found.append((rows[is_known], stamp_ns[is_known], pose[is_known]))
    rows, stamp_ns, poses = (np.concatenate(each) for each in zip(*found, strict=True))
    return rows, stamp_ns, poses


def _line(parents: Mapping[str, str], frame: str) -> list[str]:
    """A frame and those above it."""
    line = [frame]
    while (parent := parents.get(line[-1])) is not None and parent not in line:
        line.append(parent)
    return line


def _in_common(frames: Sequence[str], known: Mapping[str, _Poses], stamp_ns: np.ndarray) -> np.ndarray:
    """Matrices (n, 4, 4) from the first of ``frames``, each below the next, to the parent of the last.

    At stamps (n,), ns, interpolated linearly and along the shortest arc; NaN where a frame is not known.
    """
    from scipy.spatial.transform import Rotation

    pose = np.tile(np.eye(4), (len(stamp_ns), 1, 1))
    for frame in frames:
        known_ns = np.array(sorted(known[frame]))
        poses = np.array([known[frame][each] for each in known_ns.tolist()])
        at_ns = np.where(_ALWAYS in known[frame], _ALWAYS, stamp_ns)
        before, after, fraction, found = brackets(known_ns, at_ns, _ANY_GAP_S)
        place, turn = poses[:, :3], Rotation.from_quat(poses[:, 3:])
        step = fraction[:, None] * (turn[before].inv() * turn[after]).as_rotvec()
        matrices = np.tile(np.eye(4), (len(stamp_ns), 1, 1))
        matrices[:, :3, :3] = (turn[before] * Rotation.from_rotvec(step)).as_matrix()
        matrices[:, :3, 3] = place[before] + fraction[:, None] * (place[after] - place[before])
        matrices[~found, :3] = np.nan
        pose = matrices @ pose
    return pose
