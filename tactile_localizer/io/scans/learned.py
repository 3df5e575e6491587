"""Cache of results computed from a scan, stored in the scan file for the next start.

A result is returned only for exactly the data that it was computed from. A failure to store it costs only
the time to compute it again.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import logging
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tactile_localizer.core.calibration.held_out import Calibration
from tactile_localizer.core.factory import learn
from tactile_localizer.core.likelihood.strain_map import VarianceModel
from tactile_localizer.core.scan.digest import digest_of
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import ScanError
from tactile_localizer.io.scans.rows import LearnedEntry
from tactile_localizer.io.scans.store import ScanStore
from tactile_localizer.scene import Scene

_log = logging.getLogger(__name__)


KEY = "calibration on held-out sweeps, 8"
"""Key of stored calibrations; the number changes with the algorithm of :func:`~.factory.learn`."""


def learned_calibration(
    path: Path, scan: Scan, scene: Scene, progress: Callable[[str, float], None] | None = None
) -> Calibration:
    """Calibration of a scan, stored in its file or computed by :func:`~.factory.learn` and then stored.

    Parameters
    ----------
    path : scan file; a file that cannot be written is left unchanged
    scan, scene : training pairs and their scene
    progress : called with a description of the step and its completed fraction
    """
    calibration, entry = find_calibration(path, scan, scene, progress)
    if entry is not None:
        store_learned(path, entry)
    return calibration


def store_learned(path: Path, entry: LearnedEntry) -> bool:
    """Store a result in a scan file; returns whether that succeeded.

    A file that cannot be written (read-only, on a full disk, or being recorded) is left unchanged, and the
    failure is logged as a warning.
    """
    try:
        with ScanStore.open(path, writable=True) as store:
            store.store_learned(entry)
    except (ScanError, OSError) as error:
        _log.warning("%s: %s could not be stored for the next start: %s", path, entry.key, error)
        return False
    return True


def load_learned(path: Path, key: str, digest: str) -> bytes | None:
    """Result stored in a scan file, as from :meth:`.reader.ScanReader.learned`; ``None`` without a file."""
    try:
        with ScanStore.open(path) as store:
            return store.learned(key, digest)
    except ScanError:
        return None


def find_calibration(
    path: Path, scan: Scan, scene: Scene, progress: Callable[[str, float], None] | None = None
) -> tuple[Calibration, LearnedEntry | None]:
    """The calibration of a scan, and the entry to store in the scan file; ``None`` if it is stored already.

    Takes the parameters of :func:`learned_calibration` and only reads the file.
    """
    digest = digest_of(scan, scene)
    if (kept := load_learned(path, KEY, digest)) is not None:
        with contextlib.suppress(KeyError, TypeError, ValueError):
            calibration = calibration_from_dict(json.loads(kept))
            if calibration.registration_std.shape == (scene.dimension,):
                return calibration, None
    calibration = learn(scan, scene, progress)
    return calibration, LearnedEntry(KEY, digest, json.dumps(calibration_to_dict(calibration)).encode())


def calibration_to_dict(calibration: Calibration) -> dict[str, Any]:
    """JSON form of a calibration."""
    return {
        "information_length": calibration.information_length,
        "registration_std": calibration.registration_std.tolist(),
        "variance": calibration.variance and dataclasses.asdict(calibration.variance),
    }


def calibration_from_dict(values: Mapping[str, Any]) -> Calibration:
    """Calibration from its JSON form; raises KeyError, TypeError or ValueError if it is another one."""
    return Calibration(
        float(values["information_length"]),
        np.array(values["registration_std"], dtype=np.float64),
        values["variance"] and VarianceModel(**values["variance"]),
    )
