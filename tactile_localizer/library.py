"""Functions for use of the package as a library: load a scan, make a localizer, read recordings."""

from pathlib import Path
from typing import Any

import numpy as np

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.core.localizer import Localizer
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.io.readers import reader_of
from tactile_localizer.io.recording import Recording
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


def read_recording(path: str | Path, scene: Scene, **options: Any) -> Recording:
    """The sweeps of a recording of the kind that its suffix says.

    Parameters
    ----------
    path : CSV file, folder of a scan, file or folder of a bag, CAN log, or what another package reads
        (:mod:`~tactile_localizer.io.readers`)
    scene : scene whose axes and phalanges are read
    options : arguments of the reader: ``naming`` of a CSV file with other than the standard names of columns,
        those of :func:`~tactile_localizer.io.csv.recording.read_csv` and
        :func:`~tactile_localizer.io.bags.recording.read_bag`; ``dbc`` and ``poses`` of a CAN log

    Raises
    ------
    ScanError
        The recording cannot be read, or no reader has its suffix.
    SceneError
        The recording lacks an axis or a phalanx of the scene.
    """
    return reader_of(path).read(path, scene, **options)
