"""Proposal of a scene from the columns and positions of CSV files."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tactile_localizer.io.csv.columns import ColumnNaming, channel_names, missing_column, phalanges_in
from tactile_localizer.io.csv.recording import read_csv, read_rows
from tactile_localizer.scene import (
    AXIS_NAMES,
    DEFAULT_MOTION_STD,
    LARGEST_POSITION,
    Axis,
    Phalanx,
    Scene,
)

MARGIN_M = 0.005
"""Added to the recorded positions on each side, m: docs/essentials.md recommends 2 to 5 mm."""

_LONGEST_M = 3.0
"""Longest plausible range of positions on material, m (judgement)."""

_UNLIKELY = " (positions in mm? --column x=NAME*0.001)"

_MARGIN_RAD = 0.1
"""The same on yaw, rad."""


def propose_scene(
    name: str, paths: Sequence[str], naming: ColumnNaming, poses: Sequence[str] = ()
) -> tuple[Scene, list[str]]:
    """Make a scene for a recording.

    Parameters
    ----------
    name : of the scene
    paths : CSV files with the strain
    naming : columns with other than the standard names, and constant speeds
    poses : CSV files with the positions, if they are separate

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
    header = _header(paths[0])
    beside = _header(poses[0]) if poses else header
    known = {*naming.columns, *naming.speed, *beside}
    axes = [axis for axis in AXIS_NAMES if axis in known]
    if not axes:
        raise missing_column(Path((*poses, *paths)[0]), beside, "x", naming, None)
    counts = phalanges_in(header, naming)
    if not counts:
        raise missing_column(Path(paths[0]), header, "finger", naming, None)
    offset = (0.0,) * len(axes)
    phalanges = tuple(Phalanx(phalanx, offset, count) for phalanx, count in counts.items())
    largest = {axis: math.pi if axis == "yaw" else LARGEST_POSITION for axis in axes}
    anywhere = Scene(name, tuple(Axis(axis, -largest[axis], largest[axis]) for axis in axes), phalanges)
    recording = read_csv(paths, anywhere, naming, poses=poses)
    position = np.concatenate([sweep.position for sweep in recording.sweeps])
    assumptions = [_origin(phalanx, naming) for phalanx in phalanges]
    bounded = []
    for axis, low, high in zip(
        axes, position.min(axis=0).tolist(), position.max(axis=0).tolist(), strict=True
    ):
        margin = _MARGIN_RAD if axis == "yaw" else MARGIN_M
        lower, upper = round(low - margin, 4), round(high + margin, 4)
        bounded.append(Axis(axis, max(lower, -largest[axis]), min(upper, largest[axis])))
        unit, factor = ("rad", 1.0) if axis == "yaw" else ("mm", 1e3)
        source = f"{naming.speed[axis]:g} m/s from 0" if axis in naming.speed else "recorded"
        assumptions.append(
            f"bounds of {axis}: {factor * low:.1f} to {factor * high:.1f} {unit} ({source}), "
            f"and {factor * margin:g} {unit} on each side{_UNLIKELY * (high - low > _LONGEST_M)}"
        )
    assumptions.append(
        f"motion_std: {DEFAULT_MOTION_STD:g}, an error of {DEFAULT_MOTION_STD * 1e3:g} mm per metre"
    )
    assumptions.append("offset of every phalanx: 0; it matters where the hand turns, or another hand is used")
    return Scene(name, tuple(bounded), phalanges), assumptions


def _origin(phalanx: Phalanx, naming: ColumnNaming) -> str:
    standard = channel_names(phalanx.name, phalanx.channels)
    columns = naming.columns[phalanx.name].names if phalanx.name in naming.columns else standard
    return f"phalanx {phalanx.name}: {phalanx.channels} channels, {columns[0]} to {columns[-1]}"


def _header(path: str) -> list[str]:
    return next(read_rows(Path(path)), (0, []))[1]
