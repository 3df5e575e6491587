"""Each scan is learned from once in a run of the tests, whichever of them need it, by all workers together.

A test of learning itself calls :func:`tactile_localizer.core.factory.learn`.
"""

import fcntl
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tactile_localizer.core.calibration.calibration import Calibration
from tactile_localizer.core.factory import learn
from tactile_localizer.core.scan.digest import digest_of
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Scene

_folder = Path()


def keep_in(folder: Path) -> None:
    """Keep what is learned in a folder of this run of the tests."""
    global _folder  # noqa: PLW0603 - one run has one
    folder.mkdir(exist_ok=True)
    _folder = folder


def learn_once(scan: Scan, scene: Scene, progress: Callable[[str, float], None] | None = None) -> Calibration:
    """As :func:`~.factory.learn`, or what it returned before for this scan and scene."""
    kept = _folder / digest_of(scan, scene)
    with kept.open("a+b") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        file.seek(0)
        if content := file.read():
            calibration: Calibration = pickle.loads(content)  # noqa: S301 - this run wrote it
            return calibration
        calibration = learn(scan, scene, progress)
        pickle.dump(calibration, file)
    return calibration


def unexamined(_scan: Scan, scene: Scene, _progress: object = None) -> Calibration:
    """In place of learning, in tests of what is imported, which do not ask what it is good for."""
    return Calibration(np.full(scene.dimension, 1e-3))
