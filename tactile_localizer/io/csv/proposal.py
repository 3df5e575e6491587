"""Proposal of a scene from the columns and positions of CSV files."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tactile_localizer.errors import ScanError
from tactile_localizer.io.csv.columns import ColumnNaming, missing_column, phalanges_in
from tactile_localizer.io.csv.recording import read_csv
from tactile_localizer.io.csv.rows import read_rows
from tactile_localizer.scene import (
    AXIS_NAMES,
    DEFAULT_MOTION_STD,
    LARGEST_POSITION,
    Axis,
    Phalanx,
    Scene,
)
from tactile_localizer.streams.synchronization import DEFAULT_MAX_GAP_S


def propose_scene(
    name: str,
    paths: Sequence[str],
    naming: ColumnNaming,
    poses: Sequence[str] = (),
    max_gap_s: float = DEFAULT_MAX_GAP_S,
) -> tuple[Scene, list[str]]:
    """Make a scene for a recording.

    Parameters
    ----------
    name : of the scene
    paths : CSV files with the strain
    naming : columns with other than the standard names
    poses : CSV files with the positions, if they are separate
    max_gap_s : longest time between two poses across which is interpolated, s

    Returns
    -------
    scene, assumptions : the scene, and one line for each thing that was assumed

    Raises
    ------
    MissingColumnError
        There is no column of a position, or none of a phalanx.
    ScanError
        A file cannot be read.
    """
    path, beside = Path(paths[0]), Path((*poses, *paths)[0])
    named = [name for columns in naming.columns.values() for name in columns.names]
    known = [*AXIS_NAMES, *naming.of("stamp_s").names, *named]
    files = {each: read_rows(each, known)[0] for each in (path, beside)}
    axes = [axis for axis in AXIS_NAMES if axis in {*naming.columns, *files[beside].names}]
    if not axes:
        raise missing_column(beside, "x", naming, None, files)
    counts = phalanges_in(files[path].names, naming)
    if not counts:
        raise missing_column(path, "finger", naming, None, files)
    phalanges = tuple(Phalanx(phalanx, (0.0,) * len(axes), count) for phalanx, count in counts.items())
    largest = {axis: math.pi if axis == "yaw" else LARGEST_POSITION for axis in axes}
    anywhere = Scene(name, tuple(Axis(axis, -largest[axis], largest[axis]) for axis in axes), phalanges)
    recording = read_csv(paths, anywhere, naming, poses=poses, max_gap_s=max_gap_s)
    if not len(recording):
        raise ScanError(
            f"{recording.source}: expected strain with a position, found none: {'; '.join(recording.notes)}"
        )
    position = np.concatenate([sweep.position for sweep in recording.sweeps])
    columns = {each.name: naming.of(each.name, each.channels).names for each in phalanges}
    assumptions = [
        f"phalanx {finger}: {len(found)} channels, {found[0]} to {found[-1]}"
        for finger, found in columns.items()
    ]
    bounded = []
    for axis, low, high in zip(axes, position.min(0).tolist(), position.max(0).tolist(), strict=True):
        # docs/essentials.md recommends 2 to 5 mm on each side.
        margin, unit, factor = (0.1, "rad", 1.0) if axis == "yaw" else (0.005, "mm", 1e3)
        lower, upper = round(low - margin, 4), round(high + margin, 4)
        bounded.append(Axis(axis, max(lower, -largest[axis]), min(upper, largest[axis])))
        assumptions.append(
            f"bounds of {axis}: {factor * low:.1f} to {factor * high:.1f} {unit} (recorded), "
            f"and {factor * margin:g} {unit} on each side"
        )
    return Scene(name, tuple(bounded), phalanges), [
        *assumptions,
        f"motion_std: {DEFAULT_MOTION_STD:g}, an error of {DEFAULT_MOTION_STD * 1e3:g} mm per metre",
        "offset of every phalanx: 0; it matters where the hand turns, or another hand is used",
    ]
