"""Each scan is learned from once, whichever tests need it, in all workers and runs with the same code.

A test of learning itself calls :func:`tactile_localizer.core.factory.learn`.
"""

import fcntl
import hashlib
import pickle
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import scipy

from tactile_localizer.core.calibration.calibration import Calibration
from tactile_localizer.core.factory import learn
from tactile_localizer.core.scan.digest import digest_of
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.io.scans.learned import Reading
from tactile_localizer.scene import Scene

_PACKAGE = Path(__file__).parents[3] / "tactile_localizer"
_folder = Path()


def version() -> str:
    """Digest of what a calibration depends on besides scan and scene: the code that learns, its libraries."""
    digest = hashlib.sha256(f"{sys.version} {np.__version__} {scipy.__version__}".encode())
    for path in sorted([*_PACKAGE.glob("*.py"), *_PACKAGE.glob("core/**/*.py")]):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def keep_in(folder: Path) -> None:
    """Keep what is learned in a folder."""
    global _folder  # noqa: PLW0603 - one process has one
    _folder = folder


def learn_once(scan: Scan, scene: Scene, progress: Callable[[str, float], None] | None = None) -> Calibration:
    """As :func:`~.factory.learn`, or what it returned before for this scan and scene."""
    kept = _folder / digest_of(scan, scene)
    with kept.open("a+b") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        file.seek(0)
        if content := file.read():
            calibration: Calibration = pickle.loads(content)  # noqa: S301 - the tests wrote it
            return calibration
        calibration = learn(scan, scene, progress)
        file.write(pickle.dumps(calibration))
    return calibration


def calibrated_once(
    scan: Scan, scene: Scene, progress: Callable[[str, float], None] | None = None
) -> tuple[Calibration, None]:
    """In place of :func:`~.factory.learn_model`, without the model, which is learned again where needed."""
    return learn_once(scan, scene, progress), None


def unexamined(_scan: Scan, scene: Scene, _progress: object = None) -> tuple[Calibration, None]:
    """In place of learning, in tests of what is imported, which do not ask what it is good for."""
    return Calibration(np.full(scene.dimension, 1e-3)), None


def unlearned(_reading: Reading, scene: Scene, *_others: object) -> tuple[Calibration, None, None]:
    """In place of learning and keeping what a filter needs, in the same tests."""
    return unexamined(_reading.scan, scene)[0], None, None
