"""A session, live or recorded: strain and palm poses come in as they arrive, pairs by sweep come out.

Stamps alone decide what is old, late or missing; nothing reads a clock, so a recording gives the same result
at any playback rate. A recording is a session that was recorded: all of it comes in before the pairs are
taken.
"""

import math
from bisect import bisect_left
from collections import deque
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from tactile_localizer.scene import Axis
from tactile_localizer.streams.arrivals import Arrivals, Seen
from tactile_localizer.streams.runs import LATE, NANOSECONDS, POSES, STRAIN, Runs
from tactile_localizer.streams.sweep_detector import NO_SWEEP, SweepDetector
from tactile_localizer.streams.synchronization import DEFAULT_MAX_GAP_S, interpolate_pose

T = TypeVar("T")

DEFAULT_PATIENCE_S = 1.0
"""Longest time, by stamps, that a strain vector waits for the pose that follows it, s."""


@dataclass(frozen=True)
class Pair(Generic[T]):
    """A strain vector with the palm position at its stamp.

    Parameters
    ----------
    stamp_ns : of the strain vector, ns
    position : (d,) palm position, m (yaw: rad); ``None`` when no pose was near enough in time
    measurement : the strain vector, in the form given to :meth:`Session.add_strain`
    run : number of backward jumps of the strain before it; a sweep does not go on in another run
    sweep : number of its sweep, or :data:`~.sweep_detector.NO_SWEEP`
    """

    stamp_ns: int
    position: np.ndarray | None
    measurement: T
    run: int = 0
    sweep: int = NO_SWEEP


class _Waiting(NamedTuple):
    """A strain vector that waits for a pose since a time, in a run of both topics, and of the strain."""

    both: int
    run: int
    stamp_ns: int
    measurement: Any
    since_ns: int


class _Elapsed:
    """Time by the stamps of a topic, in which a clock that is set forward makes no step, ns.

    A step longer than ``longest_ns`` counts as the one before it, if as much time has passed in shorter steps
    since the last such one: a topic that is slow, or comes in bursts, sets no clock.
    """

    def __init__(self, longest_ns: float) -> None:
        self.ns = 0
        self._longest_ns, self._newest_ns, self._step_ns = longest_ns, math.inf, 0
        self._steady_ns = longest_ns  # time in shorter steps

    def add(self, stamp_ns: int) -> int:
        step_ns = int(max(stamp_ns - self._newest_ns, 0))
        self._newest_ns = stamp_ns
        if step_ns <= self._longest_ns:
            self._steady_ns += step_ns
        elif self._steady_ns >= self._longest_ns:
            self._steady_ns, step_ns = 0, self._step_ns
        self.ns += step_ns
        self._step_ns = step_ns
        return self.ns


class Session(Generic[T]):
    """Pairs strain vectors with palm positions by their stamps, and finds the sweep of each pair.

    A strain vector waits for the pose that follows it, whichever topic is late, also where time jumps back
    (see :class:`~.runs.Runs`). A sweep is an interval of time: it holds what is stamped after one mark up to
    the next, whenever it arrives; where the strain jumps back, another sweep of the same mark begins.

    Parameters
    ----------
    axes : the d axes
    max_gap_s : longest time between the two poses around a strain vector, s
    patience_s : a strain vector that is older than the newest by more than this waits no longer, s, not
        counting that a clock is set forward; that of a recording, all of which comes in before the pairs are
        taken, may wait for ever
    delay_s : time by which the strain is late against the poses, s; its stamps become those when it was felt
    detector : detects the sweeps in the motion; ``None``: :meth:`mark` begins and ends them
    arrivals : keeps what arrives in time, for :meth:`seen`

    Attributes
    ----------
    runs : runs of both topics
    delay_ns : time that is subtracted from the stamps of the strain, ns
    forward_jumps : number of strain stamps more than ``patience_s`` after the last: silence, or a clock set
    """

    def __init__(
        self,
        axes: tuple[Axis, ...],
        *,
        max_gap_s: float = DEFAULT_MAX_GAP_S,
        patience_s: float = DEFAULT_PATIENCE_S,
        delay_s: float = 0.0,
        detector: SweepDetector | None = None,
        arrivals: Arrivals | None = None,
    ) -> None:
        self._arrivals = arrivals or Arrivals(0, 0)
        self.runs, self.forward_jumps = Runs(), 0
        self._axes, self._max_gap_s, self._detector = axes, max_gap_s, detector
        self._patience_ns = patience_s * NANOSECONDS
        self.delay_ns = round(delay_s * NANOSECONDS)
        # Poses are kept for as long as a strain vector that needs them may wait.
        self._length_ns = 2 * self._patience_ns + max_gap_s * NANOSECONDS
        self._elapsed = {topic: _Elapsed(self._patience_ns) for topic in (STRAIN, POSES)}
        # Stamps, positions, and when they came, by run.
        self._poses: dict[int, tuple[list[int], list[np.ndarray], list[int]]] = {}
        self._waiting: deque[_Waiting] = deque()
        self._marks: list[tuple[int, int, int]] = []  # run, stamp and sweep, ascending

    @property
    def has_marks(self) -> bool:
        """Whether sweeps begin and end at marks."""
        return bool(self._marks)

    @property
    def late(self) -> int:
        """Number of poses and strain vectors dropped because a later one had already arrived."""
        return sum(self.runs.late)

    @property
    def resets(self) -> int:
        """Number of backward jumps of the stamps."""
        return max(self.runs.jumps)

    @property
    def run(self) -> int:
        """Run of the newest strain vector."""
        return self.runs.jumps[STRAIN]

    @property
    def newest_ns(self) -> int | None:
        """Stamp of the newest strain vector, ns; ``None`` before the first."""
        return self.runs.newest_ns[STRAIN]

    @property
    def newest_pose_ns(self) -> int | None:
        """Stamp of the newest pose, ns; ``None`` before the first."""
        return self.runs.newest_ns[POSES]

    @property
    def newest_input_ns(self) -> int:
        """Stamp of the newest strain vector or pose, ns; 0 before the first."""
        return max(self.newest_ns or 0, self.newest_pose_ns or 0)

    @property
    def settled(self) -> tuple[int, int]:
        """Run and stamp, ns, up to which all strain that has arrived is in pairs; -1 before the first."""
        if self._waiting:
            return self._waiting[0].run, self._waiting[0].stamp_ns - 1
        return self.run, -1 if self.newest_ns is None else self.newest_ns

    @property
    def waiting(self) -> int:
        """Number of strain vectors that wait for a pose, or to be taken."""
        return len(self._waiting)

    def seen(self, option: str = "--max-gap", latest: int = 0) -> Seen:
        """What has arrived, for findings; see :meth:`.Arrivals.seen`."""
        return self._arrivals.seen(self._axes, self._max_gap_s, option, latest)

    def add_pose(self, stamp_ns: int, position: np.ndarray, received_ns: int | None = None) -> None:
        """Add a finite palm position (d,), m (yaw: rad), with its time of receipt, ns, if that is known."""
        if (run := self.runs.add(POSES, stamp_ns)) == LATE:
            return
        self._arrivals.add_pose(stamp_ns, position, received_ns)
        now_ns = self._elapsed[POSES].add(stamp_ns)
        pose_ns, poses, came_ns = self._poses.setdefault(run, ([], [], []))
        pose_ns.append(stamp_ns)
        poses.append(position)
        came_ns.append(now_ns)
        # Deleting only once half of the poses are old makes the cost per pose constant.
        if 2 * (now_ns - came_ns[0]) > 3 * self._length_ns:
            old = bisect_left(came_ns, now_ns - self._length_ns)
            del pose_ns[:old], poses[:old], came_ns[:old]

    def add_strain(self, stamp_ns: int, measurement: T, received_ns: int | None = None) -> None:
        """Add a strain vector, with its time of receipt, ns, if that is known."""
        newest_ns, stamp_ns = self.newest_ns, stamp_ns - self.delay_ns
        if (both := self.runs.add(STRAIN, stamp_ns)) == LATE:
            return
        # The clocks agree where strain is known to be late.
        self._arrivals.add_strain(stamp_ns, received_ns and received_ns - self.delay_ns)
        self.forward_jumps += newest_ns is not None and stamp_ns - newest_ns > self._patience_ns
        now_ns = self._elapsed[STRAIN].add(stamp_ns)
        self._waiting.append(_Waiting(both, self.run, stamp_ns, measurement, now_ns))

    def mark(self, run: int, after_ns: int, sweep: int) -> None:
        """Begin a sweep after a stamp of a run, ns; :data:`~.sweep_detector.NO_SWEEP` only ends the last one.

        It takes the place of the marks that are not before it, and holds until the next one.
        """
        while self._marks and self._marks[-1][:2] >= (run, after_ns):
            self._marks.pop()
        self._marks.append((run, after_ns, sweep))

    def take(self) -> list[Pair[T]]:
        """The pairs that are complete, in the order of arrival of their strain."""
        ready, (strain_run, pose_run) = list[_Waiting](), self.runs.number
        while self._waiting:
            first = self._waiting[0]
            pose_ns, *_ = self._poses.get(first.both, ([],))
            is_covered = pose_run > first.both or (pose_ns and pose_ns[-1] >= first.stamp_ns)
            waited_ns = self._elapsed[STRAIN].ns - first.since_ns if first.both == strain_run else 0
            if not is_covered and waited_ns <= self._patience_ns:
                break
            ready.append(self._waiting.popleft())
        pairs = self._paired(ready)
        oldest = self._waiting[0].both if self._waiting else strain_run
        self._poses = {run: each for run, each in self._poses.items() if run >= oldest}
        return pairs

    def finish(self, until_ns: float = math.inf) -> list[Pair[T]]:
        """The pairs, with the strain vectors stamped up to ``until_ns`` that no pose follows."""
        pairs, unpaired = self.take(), list[_Waiting]()
        while self._waiting and self._waiting[0].stamp_ns <= until_ns:
            unpaired.append(self._waiting.popleft())
        return pairs + self._paired(unpaired)

    def _paired(self, strain: list[_Waiting]) -> list[Pair[T]]:
        pairs = list[Pair[T]]()
        for both, run, stamp_ns, measurement, _ in strain:
            pose_ns, poses, _ = self._poses.get(both, ([], [], []))
            position = interpolate_pose(self._axes, pose_ns, poses, stamp_ns, self._max_gap_s)
            sweep = self._sweep(run, stamp_ns, position)
            pairs.append(Pair(stamp_ns, position, measurement, run, sweep))
        return pairs

    def _sweep(self, run: int, stamp_ns: int, position: np.ndarray | None) -> int:
        if self._detector is not None:
            place = np.full(len(self._axes), math.nan) if position is None else position
            return self._detector.update(stamp_ns, place, run)
        before = bisect_left(self._marks, (run, stamp_ns))
        return self._marks[before - 1][2] if before else NO_SWEEP
