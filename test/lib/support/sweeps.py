"""Simulated sweeps for tests of localization: scans, and sweeps that are in none."""

from functools import lru_cache
from pathlib import Path

import numpy as np

from tactile_localizer.core.calibration.calibration import Calibration
from tactile_localizer.core.calibration.examination import Examination
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.core.likelihood.strain_map import VarianceModel
from tactile_localizer.core.scan.digest import digest_of
from tactile_localizer.io.recording import RecordedSweep, Recording
from tactile_localizer.io.scans.folder import ScanFolder
from tactile_localizer.io.scans.learned import FILE, store_calibration
from tactile_localizer.io.scans.writer import ScanWriter
from tactile_localizer.scene import Scene
from tactile_localizer.sim import shipped_scene, simulate_recording, simulate_sweep

CALIBRATION = Calibration(
    np.array([0.0004, 0.0004]),
    Material.SHEET,
    VarianceModel(visit=0.21, signal=0.036, interpolation=0.18),
    Examination(0.0017, 0.0017),
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
