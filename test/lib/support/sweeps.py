"""Simulated sweeps for tests of localization: scans, and a hand that slides once."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from tactile_localizer.core.calibration.calibration import Calibration
from tactile_localizer.core.calibration.examination import Examination
from tactile_localizer.core.likelihood.strain_map import VarianceModel
from tactile_localizer.core.scan.digest import digest_of
from tactile_localizer.io.recording import RecordedSweep, Recording
from tactile_localizer.io.scans.folder import ScanFolder
from tactile_localizer.io.scans.learned import FILE, store_calibration
from tactile_localizer.io.scans.writer import ScanWriter
from tactile_localizer.scene import Scene
from tactile_localizer.sim import shipped_scene, simulate_recording, simulate_sweep

START_NS = 1_700_000_000_000_000_000
CALIBRATION = Calibration(
    np.array([0.0004, 0.0004]),
    VarianceModel(visit=0.21, signal=0.036, interpolation=0.18),
    Examination(information_length=0.0017),
)
"""Calibration stored in the scans of the shipped scenes, so that tests do not wait for it."""


def write_scan(
    path: Path,
    feature: str = "bump",
    scene: Scene | None = None,
    *,
    calibrated: bool = True,
    short: bool = False,
) -> None:
    """Write a training scan of the simulated hand, or a part that is learned from soon.

    With a calibration or not.
    """
    scene = scene or shipped_scene(feature)
    with ScanWriter(path, scene) as writer:
        sweeps = _simulated(feature).sweeps[: 8 if short else None]
        for number, sweep in enumerate(sweeps, start=1):
            writer.add(sweep.part(slice(200 if short else None), number))
    if calibrated and scene.dimension == len(CALIBRATION.registration_std):
        store_calibration(path / FILE, digest_of(ScanFolder(path).load(), scene), CALIBRATION)


@lru_cache
def _simulated(feature: str) -> Recording:
    return simulate_recording(feature, seed=1)


def unseen_sweep(feature: str = "bump", number: int = 0, rate: float = 25.0) -> RecordedSweep:
    """A sweep that is in no scan, from x = 4 mm on between two scanned lines."""
    return simulate_sweep(feature, seed=1, number=number, start=(0.004, 0.0241), rate=rate)


class SlidingHand:
    """Publishes a simulated sweep: strain at its samples, poses halfway between them.

    Parameters
    ----------
    probe : a :class:`support.probe.Probe`
    sweep : sweep to publish
    topics : topics of strain and poses
    poses : whether the node under test subscribes to the poses
    """

    def __init__(
        self,
        probe: Any,
        sweep: RecordedSweep,
        topics: tuple[str, str] = ("strain", "palm_pose"),
        *,
        poses: bool = True,
    ) -> None:
        from geometry_msgs.msg import PoseStamped

        from tactile_localizer.msg import StrainVectors

        self._Pose, self._Strain = PoseStamped, StrainVectors
        self._probe = probe
        self._poses = probe.publisher(PoseStamped, topics[1], 100) if poses else None
        self._strains = probe.publisher(StrainVectors, topics[0], probe.best_effort)
        self.sweep = sweep
        self.offset_ns = START_NS
        self.next = 0
        stamp_ns = sweep.stamp_ns - sweep.stamp_ns[0]
        self.strain_ns = stamp_ns + int(stamp_ns[1]) // 2
        self.pose_ns = stamp_ns

    def slide(self, samples: int, *, poses: bool = True, strain: bool = True, **changes: Any) -> None:
        """Publish the next ``samples``, paced so that best effort loses nothing.

        ``changes`` replace fields of the strain messages.
        """
        for k in range(self.next, self.next + samples):
            if poses:
                self.send_pose(k)
            if strain:
                self.send_strain(k, **changes)
            self._probe.executor.spin_once(timeout_sec=0.002)
        self.next += samples
        if poses:
            self.send_pose(self.next)

    def send_pose(self, k: int) -> None:
        message = self._Pose()
        set_stamp(message, self.offset_ns + int(self.pose_ns[k]))
        message.header.frame_id = "base_link"
        message.pose.position.x, message.pose.position.y = map(float, self.sweep.position[k])
        message.pose.orientation.w = 1.0
        self._poses.publish(message)

    def send_strain(self, k: int, **changes: Any) -> None:
        message = self._Strain()
        set_stamp(message, self.offset_ns + int(self.strain_ns[k]))
        message.phalanges, message.status, message.sequence = ["index", "middle"], [0, 0], [k, k]
        message.strain = self.sweep.strain[k].tolist()
        for name, value in changes.items():
            setattr(message, name, value)
        self._strains.publish(message)

    def sample_of(self, message: Any) -> int:
        """Index of the strain vector with the stamp of a message."""
        return int(np.flatnonzero(self.strain_ns == stamp_of(message) - self.offset_ns)[0])


def set_stamp(message: Any, stamp_ns: int) -> None:
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 1_000_000_000)


def stamp_of(message: Any) -> int:
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
