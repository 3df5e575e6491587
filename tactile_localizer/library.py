"""Functions for use of the package as a library: load a scan, make a localizer, read recordings."""

from pathlib import Path
from typing import Any

import numpy as np

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.core.localizer import Localizer
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.io.csv.columns import ColumnNaming
from tactile_localizer.io.csv.recording import read_csv
from tactile_localizer.io.recording import Recording, is_bag, is_scan
from tactile_localizer.io.scans.folder import ScanFolder
from tactile_localizer.io.scans.learned import learned_calibration
from tactile_localizer.quantity import whole_number
from tactile_localizer.scene import Scene


def load_scan(path: str | Path) -> tuple[Scan, Scene]:
    """The training pairs of a scan, and their scene.

    Raises
    ------
    ScanError
        The folder does not exist, or a sweep in it is damaged.
    """
    folder = ScanFolder(path)
    return folder.load(), folder.scene


def make_localizer(
    scan: Scan,
    scene: Scene,
    configuration: Configuration | None = None,
    *,
    seed: int = 0,
    scan_file: str | Path | None = None,
) -> Localizer:
    """A localizer on a scan; parameters that the scene leaves open are learned from the scan.

    Parameters
    ----------
    scan : training pairs
    scene : scene of the scan, or one with fewer axes and phalanges
    configuration : measurement model, filter and convergence criteria; the default is that of the filter node
    seed : seed of the random numbers; the same seed and samples give the same estimates
    scan_file : folder of the scan, which then keeps the calibration; ``None`` repeats it in each call,
        which takes seconds

    Raises
    ------
    ScanError
        ``scan_file`` is no scan.
    SceneError
        The scene and the scan are inconsistent.
    ParameterError
        A parameter is out of range.
    """
    calibration = None
    if scan_file is not None:
        calibration = learned_calibration(ScanFolder(scan_file).path, scan, scene)
    rng = np.random.default_rng(whole_number(seed, "seed", lower=0))
    return build_localizer(scan, scene, configuration or Configuration(), rng, calibration=calibration)


def read_recording(
    path: str | Path,
    scene: Scene,
    *,
    naming: ColumnNaming | None = None,
    **bag_options: Any,
) -> Recording:
    """The sweeps of a bag, a scan, or a CSV file.

    Parameters
    ----------
    path : CSV file, folder of a scan, or file or folder of a bag
    scene : scene whose axes and phalanges are read
    naming : columns of a CSV file with other than the standard names
    bag_options : arguments of :func:`~tactile_localizer.io.bags.recording.read_bag`

    Raises
    ------
    ScanError
        The recording cannot be read.
    SceneError
        The recording lacks an axis or a phalanx of the scene.
    """
    if is_bag(Path(path)):
        from tactile_localizer.io.bags.recording import read_bag  # takes a while to import

        return read_bag(path, scene, by_status=False, **bag_options)
    if is_scan(Path(path)):
        return ScanFolder(path).recording(scene)
    return read_csv(path, scene, naming)
