"""Transforms between frames over time, looked up as tf2 does."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from tactile_localizer.core.geometry.synchronization import brackets

_UNIT_TOLERANCE = 0.01
"""Largest difference of a quaternion's squared length to 1; tf2 ignores others."""


class Transform(NamedTuple):
    """Pose of frame ``child`` in its parent: x, y, z (m) and a quaternion x, y, z, w."""

    parent: str
    child: str
    stamp_ns: int
    pose: tuple[float, ...]


def look_up(
    static: Sequence[Transform],
    moving: Sequence[Transform],
    target: str,
    source: str,
    stamp_ns: np.ndarray,
    max_gap_s: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Poses of frame ``source`` in frame ``target`` at stamps.

    Parameters
    ----------
    static, moving : transforms of ``/tf_static``, which always hold, and of ``/tf``
    stamp_ns : (n,) stamps, ns
    max_gap_s : longest time between two transforms of a frame across which is interpolated, s

    Returns
    -------
    poses : (n, 4, 4) homogeneous matrices
    found : (n,) bool; none is where the frames are not connected
    """
    links: dict[str, tuple[str, dict[int, tuple[float, ...]]]] = {}
    fixed = {each.child.lstrip("/") for each in static}
    for each in filter(_is_valid, (*static, *moving)):
        parent, child = each.parent.lstrip("/"), each.child.lstrip("/")
        _, poses = links.setdefault(child, (parent, {}))
        links[child] = parent, poses
        poses.setdefault(each.stamp_ns, each.pose)

    def above(frame: str) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Poses of a frame in itself and in those above it, and which are found."""
        pose = np.tile(np.eye(4), (len(stamp_ns), 1, 1)), np.ones(len(stamp_ns), dtype=bool)
        line = {frame: pose}
        while frame in links and links[frame][0] not in line:
            parent, poses = links[frame]
            at_ns = np.full_like(stamp_ns, max(poses)) if frame in fixed else stamp_ns
            matrices, found = _interpolated(poses, at_ns, max_gap_s)
            pose = line[parent] = matrices @ pose[0], found & pose[1]
            frame = parent
        return line

    of, to = above(source.lstrip("/")), above(target.lstrip("/"))
    for frame in of:
        if frame in to:
            return np.linalg.inv(to[frame][0]) @ of[frame][0], to[frame][1] & of[frame][1]
    return np.tile(np.eye(4), (len(stamp_ns), 1, 1)), np.zeros(len(stamp_ns), dtype=bool)


def _is_valid(transform: Transform) -> bool:
    """Whether tf2 takes a transform in."""
    pose = np.array(transform.pose)
    return bool(np.isfinite(pose).all() and abs(pose[3:] @ pose[3:] - 1.0) < _UNIT_TOLERANCE)


def _interpolated(
    poses: dict[int, tuple[float, ...]], stamp_ns: np.ndarray, max_gap_s: float
) -> tuple[np.ndarray, np.ndarray]:
    """Matrices (n, 4, 4) at stamps (n,), ns, of poses by stamp, and which are found."""
    known_ns = np.array(sorted(poses))
    known = np.array([poses[each] for each in known_ns.tolist()])
    before, after, fraction, found = brackets(known_ns, stamp_ns, max_gap_s)
    place, turn = known[:, :3], Rotation.from_quat(known[:, 3:])
    step = fraction[:, None] * (turn[before].inv() * turn[after]).as_rotvec()
    matrices = np.tile(np.eye(4), (len(stamp_ns), 1, 1))
    matrices[:, :3, :3] = (turn[before] * Rotation.from_rotvec(step)).as_matrix()
    matrices[:, :3, 3] = place[before] + fraction[:, None] * (place[after] - place[before])
    return matrices, found
