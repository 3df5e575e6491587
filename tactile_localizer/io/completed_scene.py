"""Scenes completed from their scans, kept in the scan file for the next start."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable
from pathlib import Path

from tactile_localizer.core.factory import completed
from tactile_localizer.core.scan.digest import digest_of
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import SceneError
from tactile_localizer.io.scans.learned import LearnedResults
from tactile_localizer.io.scene_file import scene_from_dict, scene_to_dict
from tactile_localizer.scene import Scene

KEY = "scene completed from the scan, 1"
"""Under which the scene is kept; the number changes with what :func:`~.assembly.completed` chooses."""


def completed_scene(
    path: Path, scan: Scan, scene: Scene, progress: Callable[[str, float], None] | None = None
) -> Scene:
    """The scene with what it leaves open chosen from the scan, or as it was chosen from the same data before.

    Parameters
    ----------
    path : the scan file that the choice is kept in, where that can be written
    scan, scene : what is chosen from
    progress : told what is being done, and which share of it is done
    """
    learned, digest = LearnedResults(path), digest_of(scan, scene)
    if (kept := learned.load_learned(KEY, digest)) is not None:
        with contextlib.suppress(SceneError, ValueError):
            return scene_from_dict(json.loads(kept))
    chosen = completed(scan, scene, progress)
    if chosen != scene:
        learned.store_learned(KEY, digest, json.dumps(scene_to_dict(chosen)).encode())
    return chosen
