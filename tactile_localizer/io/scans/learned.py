"""Calibration of a scan, kept in its folder for the next start.

It is used only for exactly the pairs and the scene that it was learned from, whatever the scene's name. That
for the scan's own scene is in ``calibration.json``, and each other scene has a file beside it. A failure to
store it costs only the time to learn it again.
"""

import contextlib
import dataclasses
import json
import logging
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tactile_localizer.core.calibration.calibration import Calibration
from tactile_localizer.core.calibration.examination import Examination, Outcome
from tactile_localizer.core.factory import learn
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.core.likelihood.strain_map import VarianceModel
from tactile_localizer.core.scan.digest import digest_of
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import ScanError, SceneError
from tactile_localizer.io.recording import SCENE_OF_SCAN
from tactile_localizer.io.scene_file import load_scene, scene_to_dict
from tactile_localizer.io.whole_file import RESULT, open_file, write_text
from tactile_localizer.scene import Scene

_log = logging.getLogger(__name__)

FILE = "calibration.json"
_MOST_BYTES = 2**20
ALGORITHM = 21
"""Number that changes with the algorithm of :func:`~.factory.learn`."""


def learned_calibration(
    path: str | Path, scan: Scan, scene: Scene, progress: Callable[[str, float], None] | None = None
) -> Calibration:
    """Calibration of a scan, kept in its folder or computed by :func:`~.factory.learn` and then kept.

    Parameters
    ----------
    path : folder of the scan; if it cannot be written, that is logged as a warning
    scan, scene : training pairs and their scene
    progress : called with a description of the step and its completed fraction
    """
    digest, kept = digest_of(scan, scene), _file(Path(path), scene)
    with contextlib.suppress(OSError, ValueError, LookupError, TypeError, RecursionError):
        with open_file(kept) as file:
            content = json.loads(file.read(_MOST_BYTES))
        learned = content["learned"]
        if content == _content(digest, learned):
            return Calibration(
                np.array(learned["registration_std"]),
                Material(learned["material"]),
                learned["variance"] and VarianceModel(**learned["variance"]),
                _examination(learned["examination"]),
            )
    calibration = learn(scan, scene, progress)
    store_calibration(kept, digest, calibration)
    return calibration


def _file(folder: Path, scene: Scene) -> Path:
    """File of the calibration of a scan for a scene."""
    own = None
    with contextlib.suppress(SceneError):
        own = dataclasses.replace(load_scene(folder / SCENE_OF_SCAN), name=scene.name)
    text = json.dumps(scene_to_dict(dataclasses.replace(scene, name="")))
    return folder / (FILE if own in (None, scene) else f"calibration_{zlib.crc32(text.encode()):08x}.json")


def store_calibration(path: Path, digest: str, calibration: Calibration) -> None:
    """Write a calibration to a file in the folder of a scan; a failure is logged as a warning."""
    learned = {
        "registration_std": calibration.registration_std.tolist(),
        "material": calibration.material.value,
        "variance": calibration.variance and dataclasses.asdict(calibration.variance),
        "examination": dataclasses.asdict(calibration.examination),
    }
    text = json.dumps(_content(digest, learned), indent=2) + "\n"
    try:
        write_text(path, text)
    except ScanError as error:
        _log.warning("%s; the next start calibrates again", error)


def _content(digest: str, learned: dict[str, Any]) -> dict[str, Any]:
    """What the file holds."""
    checksum = zlib.crc32(json.dumps(learned).encode())
    about = {"kind": RESULT, "algorithm": ALGORITHM, "digest": digest, "checksum": checksum}
    return about | {"learned": learned}


def _examination(values: dict[str, Any]) -> Examination:
    """The examination of a scan from its JSON, which has lists in place of tuples."""
    outcomes = [Outcome(**_with_tuples(each)) for each in values.pop("outcomes")]
    return Examination(**_with_tuples(values | {"outcomes": outcomes}))


def _with_tuples(values: dict[str, Any]) -> dict[str, Any]:
    def converted(value: Any) -> Any:
        return tuple(map(converted, value)) if isinstance(value, list) else value

    return {name: converted(value) for name, value in values.items()}
