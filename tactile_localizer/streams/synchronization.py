"""Palm positions at the stamps of strain vectors, in recordings and live.

Positions are interpolated linearly and yaw along the shortest arc. Stamps alone decide what is old, late or
missing; nothing reads a clock, so a recording gives the same result at any playback rate.
"""

import math
from bisect import bisect_left
from collections import deque
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from tactile_localizer.core.geometry.angles import wrap_angle
from tactile_localizer.scene import Axis
from tactile_localizer.streams.runs import (
    LATE,
    NANOSECONDS,
    POSES,
    STRAIN,
    Runs,
    runs_of,
    runs_of_both,
)

T = TypeVar("T")

DEFAULT_MAX_GAP_S = 0.1
"""Longest time between two poses across which positions are still interpolated, s."""

DEFAULT_PATIENCE_S = 1.0
"""Longest time, by stamps, that a strain vector waits for the pose that follows it, s."""


def near_bounds(axes: tuple[Axis, ...], positions: np.ndarray) -> np.ndarray:
    """Positions (..., d), m (yaw: rad), with yaw within half a turn of the middle of its bounds."""
    for column, axis in enumerate(axes):
        if axis.name == "yaw":
            middle = (axis.lower + axis.upper) / 2
            positions = positions.copy()
            positions[..., column] = middle + wrap_angle(positions[..., column] - middle)
    return positions


def brackets(
    known_ns: np.ndarray, stamp_ns: np.ndarray, max_gap_s: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """What is known before and after stamps, and where they lie in between.

    Parameters
    ----------
    known_ns : (m,) stamps of what is known, ns, ascending; at least one
    stamp_ns : (n,) stamps, ns
    max_gap_s : longest time between the two known stamps around a stamp, s

    Returns
    -------
    before, after : (n,) int, rows of what is known; equal where a stamp is known
    fraction : (n,) of the way from before to after
    found : (n,) bool; false before the first known stamp, after the last, and in gaps
    """
    after = np.searchsorted(known_ns, stamp_ns)
    inside = after < len(known_ns)
    after = np.minimum(after, len(known_ns) - 1)
    exact = known_ns[after] == stamp_ns
    inside &= exact | (after > 0)
    before = np.where(exact, after, np.maximum(after - 1, 0))
    span = known_ns[after] - known_ns[before]
    fraction = (stamp_ns - known_ns[before]) / np.maximum(span, 1)
    return before, after, fraction, inside & (span <= round(max_gap_s * NANOSECONDS))


def interpolate_poses(
    axes: tuple[Axis, ...],
    pose_ns: np.ndarray,
    poses: np.ndarray,
    stamp_ns: np.ndarray,
    max_gap_s: float = DEFAULT_MAX_GAP_S,
) -> tuple[np.ndarray, np.ndarray]:
    """Interpolate recorded palm poses at the stamps of strain vectors.

    Parameters
    ----------
    axes : the d axes
    pose_ns : (m,) stamps of the poses, ns, ascending
    poses : (m, d) palm positions, m (yaw: rad)
    stamp_ns : (n,) stamps of the strain vectors, ns
    max_gap_s : longest time between the two poses around a stamp, s

    Returns
    -------
    positions : (n, d) ndarray; NaN where there is none
    found : (n,) bool; false before the first pose, after the last, and in gaps
    """
    positions = np.full((len(stamp_ns), len(axes)), math.nan)
    if not len(pose_ns):
        return positions, np.zeros(len(stamp_ns), dtype=bool)
    before, after, fraction, found = brackets(pose_ns, stamp_ns, max_gap_s)
    step = poses[after] - poses[before]
    for column, axis in enumerate(axes):
        if axis.name == "yaw":
            step[:, column] = wrap_angle(step[:, column])
    positions[found] = near_bounds(axes, poses[before] + fraction[:, None] * step)[found]
    return positions, found


def pair_recorded(
    axes: tuple[Axis, ...],
    stamp_ns: np.ndarray,
    pose_ns: np.ndarray,
    poses: np.ndarray,
    max_gap_s: float = DEFAULT_MAX_GAP_S,
    strain_before: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pair recorded strain vectors with palm poses as :class:`Pairing` does live; see :class:`Runs`.

    Parameters
    ----------
    axes : the d axes
    stamp_ns : (n,) stamps of the strain vectors, in the order of arrival or of the rows of a file, ns
    pose_ns, poses : (m,) and (m, d) the same of the palm poses, which are finite, m (yaw: rad)
    max_gap_s : longest time between the two poses around a stamp, s
    strain_before : (m,) number of strain vectors that had arrived before each pose, which a bag knows;
        ``None``: of separate files, runs are paired in their order, or all with the only run of the poses

    Returns
    -------
    positions : (n, d) ndarray; NaN where there is none
    found : (n,) bool
    sweep : (n,) int, number of backward jumps of the strain before each, or :data:`LATE`
    """
    sweep, pose_run = runs_of(stamp_ns), runs_of(pose_ns)
    run = sweep if pose_run.max(initial=0) else np.minimum(sweep, 0)
    if strain_before is not None and (sweep.max(initial=0) or pose_run.max(initial=0)):
        run, pose_run = runs_of_both(stamp_ns, pose_ns, strain_before)
    positions = np.full((len(stamp_ns), len(axes)), math.nan)
    found = np.zeros(len(stamp_ns), dtype=bool)
    for number in set(run.tolist()) - {LATE}:
        rows, near = run == number, pose_run == number
        positions[rows], found[rows] = interpolate_poses(
            axes, pose_ns[near], poses[near], stamp_ns[rows], max_gap_s
        )
    return positions, found, sweep


_ZONE_S, _IN_ZONES_S, _MOST_ZONES_S = 900.0, 1.0, 26 * 3600.0
"""Time zones differ by multiples of a quarter of an hour, s; difference from one that is none of a zone, s
(judgement); largest difference of two zones, s."""
_QUANTILES = np.linspace(0.0, 1.0, 101)


def clock_difference_s(stamp_ns: np.ndarray, pose_ns: np.ndarray) -> float:
    """Time by which the clock of the poses is ahead of that of the strain, s; 0.0 where they may be the same.

    They differ where poses and strain do not overlap, or both begin and end one difference of time zones
    apart. The difference of two zones is exact; another is the median one of equal fractions of both.

    Parameters
    ----------
    stamp_ns, pose_ns : (n,) and (m,) stamps of the strain and of the poses, ns, at least one of each
    """
    begin_ns, end_ns = (stamp_ns.min(), stamp_ns.max())
    ahead_s = (
        np.quantile(pose_ns - begin_ns, _QUANTILES) - np.quantile(stamp_ns - begin_ns, _QUANTILES)
    ) * 1e-9
    zone_s = _ZONE_S * round(float(np.median(ahead_s)) / _ZONE_S)
    is_zone = 0.0 < abs(zone_s) <= _MOST_ZONES_S and bool((abs(ahead_s - zone_s) <= _IN_ZONES_S).all())
    if is_zone:
        return zone_s
    overlaps = pose_ns.max() >= begin_ns and pose_ns.min() <= end_ns
    return 0.0 if overlaps else round(float(np.median(ahead_s)), 3)


def is_of_zones(difference_s: float) -> bool:
    """Whether a difference of two clocks, s, is that of two time zones."""
    return difference_s != 0.0 and not difference_s % _ZONE_S and abs(difference_s) <= _MOST_ZONES_S


def describe_gaps(stamp_ns: np.ndarray, pose_ns: np.ndarray, max_gap_s: float) -> str:
    """Why strain vectors have no pose close enough in time, in one line: another clock, few or slow poses.

    Parameters
    ----------
    stamp_ns, pose_ns : (n,) and (m,) stamps of the strain and of the poses, ns, at least one of each
    max_gap_s : longest time between two poses across which is interpolated, s
    """
    (begin, end), (first, last) = ((each.min(), each.max()) for each in (stamp_ns, pose_ns))
    seconds = (each / NANOSECONDS for each in (begin, end, first, last))
    ranges = "strain from {:.3f} to {:.3f} s, poses from {:.3f} to {:.3f} s".format(*seconds)
    if ahead_s := clock_difference_s(stamp_ns, pose_ns):
        way, what = "ahead of" if ahead_s > 0 else "behind", "time zone" if is_of_zones(ahead_s) else "clock"
        return f"the poses are {abs(ahead_s):.15g} s {way} the strain, another {what}? {ranges}"
    if 2 * np.count_nonzero((stamp_ns < first) | (stamp_ns > last)) > len(stamp_ns):
        return f"most of the strain is before or after all poses: {ranges}"
    apart_s = float(np.median(np.abs(np.diff(pose_ns)))) / NANOSECONDS if len(pose_ns) > 1 else 0.0
    if apart_s <= max_gap_s:
        return ""
    return (
        f"the poses are {apart_s:.2g} s apart, and positions are interpolated across at most {max_gap_s:g} "
        f"s: --max-gap {1.5 * apart_s:.2g} is right if the motion is smooth"
    )


@dataclass(frozen=True)
class Pair(Generic[T]):
    """A strain vector with the palm position at its stamp.

    Parameters
    ----------
    stamp_ns : of the strain vector, ns
    position : (d,) palm position, m (yaw: rad); ``None`` when no pose was near enough in time
    measurement : the strain vector, in the form given to :meth:`Pairing.add_strain`
    """

    stamp_ns: int
    position: np.ndarray | None
    measurement: T


class Pairing(Generic[T]):
    """Pairs strain vectors with palm positions by their stamps, as they arrive.

    A strain vector waits for the pose that follows it. Whichever topic is late, also where time jumps back,
    the pairs are those that :func:`pair_recorded` finds in a recording of both.

    Parameters
    ----------
    axes : the d axes
    max_gap_s : longest time between the two poses around a strain vector, s
    patience_s : a strain vector that is older than the newest by more than this waits no longer, s

    Attributes
    ----------
    forward_jumps : number of strain stamps more than ``patience_s`` after the last: silence, or a clock set
    """

    def __init__(
        self,
        axes: tuple[Axis, ...],
        *,
        max_gap_s: float = DEFAULT_MAX_GAP_S,
        patience_s: float = DEFAULT_PATIENCE_S,
    ) -> None:
        self.forward_jumps = 0
        self._axes = axes
        self._max_gap_s = max_gap_s
        self._patience_ns = round(patience_s * NANOSECONDS)
        # Poses are kept for as long as a strain vector that needs them may wait.
        self._length_ns = 2 * self._patience_ns + round(max_gap_s * NANOSECONDS)
        self._runs = Runs()
        self._poses: dict[int, tuple[list[int], list[np.ndarray]]] = {}  # stamps and positions by run
        self._waiting: deque[tuple[int, int, T]] = deque()  # run, stamp, measurement

    @property
    def late(self) -> int:
        """Number of poses and strain vectors dropped because a later one had already arrived."""
        return self._runs.late

    @property
    def resets(self) -> int:
        """Number of backward jumps of the stamps."""
        return max(self._runs.jumps)

    @property
    def newest_ns(self) -> int | None:
        """Stamp of the newest strain vector, ns; ``None`` before the first."""
        return self._runs.newest_ns[STRAIN]

    @property
    def newest_pose_ns(self) -> int | None:
        """Stamp of the newest pose, ns; ``None`` before the first."""
        return self._runs.newest_ns[POSES]

    @property
    def newest_input_ns(self) -> int:
        """Stamp of the newest strain vector or pose, ns; 0 before the first."""
        return max(self.newest_ns or 0, self.newest_pose_ns or 0)

    @property
    def settled_ns(self) -> int:
        """Stamp up to which each strain vector that has arrived is in a pair, ns; -1 before the first."""
        if self._waiting:
            return self._waiting[0][1] - 1
        return -1 if self.newest_ns is None else self.newest_ns

    @property
    def waiting(self) -> int:
        """Number of strain vectors that wait for a pose."""
        return len(self._waiting)

    def add_pose(self, stamp_ns: int, position: np.ndarray) -> list[Pair[T]]:
        """Add a finite palm position (d,), m (yaw: rad); returns the pairs that it completes, by stamp."""
        if (run := self._runs.add(POSES, stamp_ns)) == LATE:
            return []
        pose_ns, poses = self._poses.setdefault(run, ([], []))
        pose_ns.append(stamp_ns)
        poses.append(np.asarray(position, dtype=np.float64))
        # Deleting only once half of the poses are old makes the cost per pose constant.
        if 2 * (stamp_ns - pose_ns[0]) > 3 * self._length_ns:
            old = bisect_left(pose_ns, stamp_ns - self._length_ns)
            del pose_ns[:old], poses[:old]
        return self._complete()

    def add_strain(self, stamp_ns: int, measurement: T) -> list[Pair[T]]:
        """Add a strain vector; returns the pairs that are now complete, by stamp."""
        newest_ns = self.newest_ns
        if (run := self._runs.add(STRAIN, stamp_ns)) == LATE:
            return []
        self.forward_jumps += newest_ns is not None and stamp_ns - newest_ns > self._patience_ns
        self._waiting.append((run, stamp_ns, measurement))
        return self._complete()

    def finish(self, until_ns: float = math.inf) -> list[Pair[T]]:
        """Strain vectors stamped up to ``until_ns`` that are still waiting, without positions."""
        unpaired = []
        while self._waiting and self._waiting[0][1] <= until_ns:
            _, stamp_ns, measurement = self._waiting.popleft()
            unpaired.append(Pair(stamp_ns, None, measurement))
        return unpaired

    def _complete(self) -> list[Pair[T]]:
        pairs = []
        strain_run, pose_run = self._runs.number
        while self._waiting:
            run, stamp_ns, measurement = self._waiting[0]
            pose_ns, poses = self._poses.get(run, ([], []))
            is_covered = pose_run > run or (pose_ns and pose_ns[-1] >= stamp_ns)
            waited_ns = (self.newest_ns or 0) - stamp_ns if run == strain_run else 0
            if not is_covered and waited_ns <= self._patience_ns:
                break
            self._waiting.popleft()
            pairs.append(Pair(stamp_ns, self._position(stamp_ns, pose_ns, poses), measurement))
        oldest = self._waiting[0][0] if self._waiting else strain_run
        self._poses = {run: each for run, each in self._poses.items() if run >= oldest}
        return pairs

    def _position(self, stamp_ns: int, pose_ns: list[int], poses: list[np.ndarray]) -> np.ndarray | None:
        after = bisect_left(pose_ns, stamp_ns)
        around = slice(max(after - 1, 0), after + 1)
        positions, found = interpolate_poses(
            self._axes,
            np.array(pose_ns[around]),
            np.array(poses[around]),
            np.array([stamp_ns]),
            self._max_gap_s,
        )
        return positions[0] if found[0] else None
