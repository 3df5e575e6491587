"""What has arrived of strain and palm poses, for the findings about their clocks and the motion."""

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactile_localizer.scene import Axis
from tactile_localizer.streams.runs import NANOSECONDS


@dataclass(frozen=True)
class Seen:
    """Stamps of strain and poses, and positions.

    Parameters
    ----------
    axes : the d axes
    strain_ns : (n,) stamps of the strain, ns
    pose_ns : (m,) stamps of the poses, ns, rising within each of their runs
    position : (m, d) their positions, m (yaw: rad), finite
    max_gap_s : longest time between two poses across which is interpolated, s
    option : what sets it, for advice
    lead_s : (k,) times by which stamps of poses were ahead of those of the strain received with them, s
    """

    axes: tuple[Axis, ...]
    strain_ns: np.ndarray
    pose_ns: np.ndarray
    position: np.ndarray
    max_gap_s: float
    option: str = "--max-gap"
    lead_s: np.ndarray | None = None

    def runs(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Rising stamps (m,), ns, and positions (m, d) of each run of the poses."""
        begins = np.flatnonzero(np.diff(self.pose_ns) < 0) + 1
        return zip(np.split(self.pose_ns, begins), np.split(self.position, begins), strict=True)


Measure = Iterator[tuple[float, dict[str, Any]]]
"""Values of a measure of what was seen, and what else is said of each."""


class Arrivals:
    """The strain and poses that arrived in time, or the last of them.

    Parameters
    ----------
    poses : number of the poses that are kept; ``None``: all
    leads_s : time for which leads of their clock are kept, s
    """

    def __init__(self, poses: int | None = None, leads_s: float = math.inf) -> None:
        self._strain_ns: deque[int] = deque(maxlen=poses)
        self._poses: deque[tuple[int, np.ndarray]] = deque(maxlen=poses)
        self._leads_ns: deque[tuple[int, int]] = deque()  # with the times of receipt
        self._kept_ns = leads_s * NANOSECONDS
        self._strain_lead_ns: int | None = None

    def add_strain(self, stamp_ns: int, received_ns: int | None) -> None:
        """Add a strain vector by its stamp and time of receipt, ns, if that is known."""
        self._strain_ns.append(stamp_ns)
        self._strain_lead_ns = None if received_ns is None else stamp_ns - received_ns

    def add_pose(self, stamp_ns: int, position: np.ndarray, received_ns: int | None) -> None:
        """Add a pose, in the same way."""
        self._poses.append((stamp_ns, position))
        if received_ns is not None and self._strain_lead_ns is not None:
            self._leads_ns.append((received_ns, stamp_ns - received_ns - self._strain_lead_ns))
            while abs(received_ns - self._leads_ns[0][0]) > self._kept_ns:
                self._leads_ns.popleft()

    def seen(self, axes: tuple[Axis, ...], max_gap_s: float, option: str, latest: int = 0) -> Seen:
        """What is kept; of the poses the ``latest`` ones, or all."""
        poses = list(self._poses)[-latest:]
        return Seen(
            axes,
            np.array(self._strain_ns, dtype=np.int64),
            np.array([stamp_ns for stamp_ns, _ in poses], dtype=np.int64),
            np.reshape([position for _, position in poses], (-1, len(axes))),
            max_gap_s,
            option,
            np.array([lead_ns for _, lead_ns in self._leads_ns]) / NANOSECONDS,
        )
