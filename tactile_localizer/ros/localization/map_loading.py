"""Construction of the localizer from scan files, configured by the parameters of the filter node."""

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
    """Scans with the localizer built from them.

    Parameters
    ----------
    name : paths of the scan files
    scans, scenes : scan and scene of each file
    frame : transformation of palm poses to the axes of the scenes
    localizer : localizer on the scan, or on several candidate scans
    warnings : descriptions of inconsistencies, one line each
    """

    name: str
    scans: Sequence[Scan]
    scenes: Sequence[Scene]
    frame: PalmFrame
    localizer: Localizer | FeatureLocalizer
    warnings: Sequence[str] = ()

    @property
    def ranges(self) -> list[ScanRange]:
        """Ranges of the scans."""
        return [ScanRange.of(scan, scene) for scan, scene in zip(self.scans, self.scenes, strict=True)]

    @property
    def scan(self) -> Scan:
        """The first scan, which is the one to display."""
        return self.scans[0]


def load_map(paths: Sequence[Path], parameters: Parameters, progress: Progress) -> LoadedMap:
    """Read scan files and build the localizer; calibrations, which take seconds, are stored in the files.

    Raises
    ------
    TactileLocalizerError
        A file or a parameter is invalid, or they are inconsistent.
    """
    scans, scenes = zip(*(_read(path, parameters["scene_file"]) for path in paths), strict=True)
    frame = palm_frame(parameters, scenes[0])
    rng, choices = np.random.default_rng(parameters["seed"]), configuration(parameters)
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
    warnings = _unfit_widths(scans, scenes) if choices.uses_kernel_widths else []
    return LoadedMap(", ".join(map(str, paths)), scans, scenes, frame, localizer, warnings)


def _unfit_widths(scans: Sequence[Scan], scenes: Sequence[Scene]) -> list[str]:
    # The kernel models take half a second to import, which the default model saves.
    from tactile_localizer.core.calibration.kernel_widths import describe_unfit_widths

    return [line for line in map(describe_unfit_widths, scans, scenes) if line is not None]


def _read(path: Path, scene_file: str) -> tuple[Scan, Scene]:
    """A scan with its scene, or with the scene of ``scene_file``, checked for consistency."""
    with ScanStore.open(path) as store:
        scan, scene = store.load(), store.scene
    if scene_file:
        scene = load_scene(given_or_shipped(scene_file, "config/scenes"))
    scene.columns(scan.axes)
    scene.channels(scan.phalanges, scan.channels)
    return scan, scene
