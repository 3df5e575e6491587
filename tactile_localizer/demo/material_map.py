"""Map of the material in characters, with the true and the estimated position of the palm."""

from __future__ import annotations

import itertools

import numpy as np
from rich.text import Text

from tactile_localizer.core.geometry.phalanges import on_feature
from tactile_localizer.demo.observations import Observations
from tactile_localizer.scene import Scene

_COLUMNS, _ROWS = 52, 22
_SHADES = " ·░▒▓"
_DARKEST_RATIO = 40.0
"""Probability of a cell, relative to the uniform distribution, that is drawn darkest."""


def material_map(scene: Scene, observations: Observations) -> Text:
    """Particles as shades; the feature region as background; the truth as o, the estimate as x.

    Parameters
    ----------
    scene : scene with two axes, x to the right and y upwards
    observations : newest observations
    """
    density = np.zeros((_ROWS, _COLUMNS))
    if len(observations.particles):
        np.add.at(density, _cells(scene, observations.particles[:, :2]), observations.particles[:, 2])
    dark = max(float(density.max()), _DARKEST_RATIO / density.size)
    shades = np.ceil((len(_SHADES) - 1) * np.sqrt(density / dark)).astype(int)
    styles = np.where(_feature(scene), "yellow on grey19", "yellow")
    marks = _marks(scene, observations)
    lines = []
    for row in range(_ROWS):
        cells = [
            marks.get((row, column), (_SHADES[shades[row, column]], str(styles[row, column])))
            for column in range(_COLUMNS)
        ]
        runs = itertools.groupby(cells, key=lambda cell: cell[1])
        lines.append(Text.assemble(*(("".join(mark for mark, _ in run), style) for style, run in runs)))
    return Text("\n").join(lines)


def _marks(scene: Scene, observations: Observations) -> dict[tuple[int, int], tuple[str, str]]:
    marks = {}
    if observations.posteriors:
        posterior = observations.posteriors[-1]
        style = "bold green" if posterior.converged else "bold yellow"
        (row,), (column,) = _cells(scene, np.array([posterior.mean]))
        marks[int(row), int(column)] = ("x", style)
    if observations.truths:
        (row,), (column,) = _cells(scene, np.array([observations.truths[-1][1:]]))
        marks[int(row), int(column)] = ("o", "bold white")
    return marks


def _feature(scene: Scene) -> np.ndarray:
    """Palm positions at which a finger touches the feature, (rows, columns) bool."""
    x, y = (
        np.linspace(axis.lower, axis.upper, count)
        for axis, count in zip(scene.axes, (_COLUMNS, _ROWS), strict=True)
    )
    grid = np.stack(np.meshgrid(x, y[::-1]), axis=-1).reshape(-1, 2)
    return on_feature(scene, grid).reshape(_ROWS, _COLUMNS)


def _cells(scene: Scene, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of positions (n, 2), m; positions outside the bounds are clipped to the edge."""
    relative = (positions - scene.lower) / scene.extent
    column = np.clip(np.floor(relative[:, 0] * _COLUMNS), 0, _COLUMNS - 1).astype(int)
    row = np.clip(np.floor((1 - relative[:, 1]) * _ROWS), 0, _ROWS - 1).astype(int)
    return row, column
