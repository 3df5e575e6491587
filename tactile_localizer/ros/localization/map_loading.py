"""A localizer built from scan files; knows nothing of ROS but the parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactile_localizer.core.factory import Progress, build_identifier, build_localizer
from tactile_localizer.core.geometry.palm_frame import PalmFrame
from tactile_localizer.core.identification import FeatureLocalizer
from tactile_localizer.core.localizer import Localizer
from tactile_localizer.core.scan.range import ScanRange
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import ParameterError
from tactile_localizer.io.scans.learned import learned_calibration
from tactile_localizer.io.scans.store import ScanStore
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.resources import given_or_shipped
from tactile_localizer.ros.base.parameters import Parameters
from tactile_localizer.ros.conversions.palm_poses import palm_frame
from tactile_localizer.ros.parameters.filter import configuration
from tactile_localizer.scene import Scene


@dataclass(frozen=True)
class LoadedMap:
    """What the filter localizes on.

    Parameters
    ----------
    name : of the scan files
    scans, scenes : one of each per scan file
    frame : brings palm poses onto the scenes' axes
    localizer : over the scan, or over the several scans
    """

    name: str
    scans: Sequence[Scan]
    scenes: Sequence[Scene]
    frame: PalmFrame
    localizer: Localizer | FeatureLocalizer

    @property
    def ranges(self) -> list[ScanRange]:
        """Range of each scan."""
        return [ScanRange.of(scan, scene) for scan, scene in zip(self.scans, self.scenes, strict=True)]

    @property
    def scan(self) -> Scan:
        """The first scan, which is the one that is shown."""
        return self.scans[0]


def load_map(paths: Sequence[Path], of: Parameters, progress: Progress) -> LoadedMap:
    """Read scan files and build the localizer. The calibration, which takes seconds, is kept in the files.

    Raises
    ------
    TactileLocalizerError
        A file or a parameter cannot be used, or they do not fit together.
    """
    scans, scenes = zip(*(_read(path, of["scene_file"]) for path in paths), strict=True)
    frame = palm_frame(of, scenes[0])
    rng, choices = np.random.default_rng(of["seed"]), configuration(of)
    calibrations = [
        learned_calibration(path, scan, scene, progress)
        for path, scan, scene in zip(paths, scans, scenes, strict=True)
    ]
    localizer: Localizer | FeatureLocalizer
    if len(paths) == 1:
        localizer = build_localizer(scans[0], scenes[0], choices, rng, progress, calibrations[0])
    else:
        named = {scene.name: (scan, scene) for scan, scene in zip(scans, scenes, strict=True)}
        if len(named) < len(paths):
            names = ", ".join(scene.name for scene in scenes)
            raise ParameterError(f"candidate_scan_files: expected scenes of different names, got {names}")
        learned = dict(zip(named, calibrations, strict=True))
        localizer = FeatureLocalizer(build_identifier(named, choices, rng, progress, learned))
    return LoadedMap(", ".join(map(str, paths)), scans, scenes, frame, localizer)


def _read(path: Path, scene_file: str) -> tuple[Scan, Scene]:
    """A scan, and the scene to use it with, which fit together."""
    with ScanStore.open(path) as store:
        scan, scene = store.load(), store.scene
    if scene_file:
        scene = load_scene(given_or_shipped(scene_file, "config/scenes"))
    scene.columns(scan.axes)
    scene.channels(scan.phalanges, scan.channels)
    return scan, scene
