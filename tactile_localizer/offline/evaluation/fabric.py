"""Recordings of fabric (FabricSlide): mapped from two repeats, localised from anywhere on the third."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.io.csv.columns import load_naming
from tactile_localizer.io.csv.recording import read_csv
from tactile_localizer.io.recording import Recording, screen
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.offline.evaluation.conditions import RecordedCondition
from tactile_localizer.resources import resource_path
from tactile_localizer.scene import Scene

FABRICS = ("linen", "canvas")
STARTS = 30
TRAVEL = 0.17
"""m of each start."""

_SPEED = {"x": 0.01}
_TYPICAL_STRAIN = 0.07
"""V, standard deviation of the median channel of a simulated bump."""


def fabric_condition(name: str, seed: int, folder: Path) -> RecordedCondition:
    """Random starts on a fabric.

    The recordings are raw counts. They are scaled so that the median channel varies as the simulated ones do,
    in V: then the paper's widths, which are absolute, mean the same there.

    Parameters
    ----------
    name : one of :data:`FABRICS`
    seed : of starts, odometry noise and filter
    folder : holds ``Linen_F250_V10mmps_0.csv`` and so on

    Raises
    ------
    ScanError
        A recording is not there or cannot be read.
    """
    scene = load_scene(resource_path(f"config/scenes/{name}.yaml"))
    naming = load_naming(resource_path("config/import/fabric_slide.yaml"))
    files = [folder / f"{name.capitalize()}_F250_V10mmps_{repeat}.csv" for repeat in range(3)]
    scan = _scan(read_csv(files[:2], scene, naming, _SPEED), scene)
    recording = read_csv(files[2], scene, naming, _SPEED)
    scale = _TYPICAL_STRAIN / float(np.median(scan.strain.std(axis=0)))
    sweeps = tuple(replace(sweep, strain=scale * sweep.strain) for sweep in recording.sweeps)
    return RecordedCondition(
        name,
        seed,
        replace(scan, strain=scale * scan.strain),
        scene,
        replace(recording, sweeps=sweeps),
        starts=STARTS,
        travel=TRAVEL,
    )


def _scan(recording: Recording, scene: Scene) -> Scan:
    """The samples that importing the recording would keep."""
    sweeps = recording.sweeps
    kept = [screen(scene, sweep.position, sweep.strain, sweep.status).keep for sweep in sweeps]
    return Scan(
        states=np.concatenate([sweep.position[keep] for sweep, keep in zip(sweeps, kept, strict=True)]),
        strain=np.concatenate([sweep.strain[keep] for sweep, keep in zip(sweeps, kept, strict=True)]),
        sweep=np.concatenate(
            [np.full(keep.sum(), sweep.number) for sweep, keep in zip(sweeps, kept, strict=True)]
        ),
        axes=recording.axes,
        phalanges=recording.phalanges,
        channels=recording.channels,
    )
