"""The material from above, drawn with characters: where the palm is, and where it is believed to be."""

from __future__ import annotations

import itertools

import numpy as np
from rich.text import Text

from tactile_localizer.demo.heard import Heard
from tactile_localizer.scene import Scene

_COLUMNS, _ROWS = 52, 22
_SHADES = " ·░▒▓"
_EVEN = 40.0
"""A cell of this many times the even share of the belief is drawn darkest."""


def material_map(scene: Scene, heard: Heard) -> Text:
    """Particles as shades; the feature's region in blue; the truth as o, the estimate as x.

    Parameters
    ----------
    scene : of two axes, x to the right and y upwards
    heard : what is known at the moment
    """
    density = np.zeros((_ROWS, _COLUMNS))
    if len(heard.particles):
        np.add.at(density, _cells(scene, heard.particles[:, :2]), heard.particles[:, 2])
    dark = max(float(density.max()), _EVEN / density.size)
    shades = np.ceil((len(_SHADES) - 1) * np.sqrt(density / dark)).astype(int)
    styles = np.where(_feature(scene), "yellow on grey19", "yellow")
    marks = _marks(scene, heard)
    lines = []
    for row in range(_ROWS):
        cells = [
            marks.get((row, column), (_SHADES[shades[row, column]], str(styles[row, column])))
            for column in range(_COLUMNS)
        ]
        runs = itertools.groupby(cells, key=lambda cell: cell[1])
        lines.append(Text.assemble(*(("".join(mark for mark, _ in run), style) for style, run in runs)))
    return Text("\n").join(lines)


def _marks(scene: Scene, heard: Heard) -> dict[tuple[int, int], tuple[str, str]]:
    marks = {}
    if heard.posteriors:
        believed = heard.posteriors[-1]
        style = "bold green" if believed.converged else "bold yellow"
        (row,), (column,) = _cells(scene, believed.mean[None])
        marks[int(row), int(column)] = ("x", style)
    if heard.truths:
        (row,), (column,) = _cells(scene, np.array([heard.truths[-1][1:]]))
        marks[int(row), int(column)] = ("o", "bold white")
    return marks


def _feature(scene: Scene) -> np.ndarray:
    """Cells where some finger touches the feature when the palm is there, (rows, columns) bool."""
    x, y = (
        np.linspace(axis.lower, axis.upper, count)
        for axis, count in zip(scene.axes, (_COLUMNS, _ROWS), strict=True)
    )
    grid = np.stack(np.meshgrid(x, y[::-1]), axis=-1).reshape(-1, 2)
    return scene.on_feature(grid).reshape(_ROWS, _COLUMNS)


def _cells(scene: Scene, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of positions (n, 2), m; those beyond the bounds at the edge."""
    share = (positions - scene.lower) / (scene.upper - scene.lower)
    column = np.clip(np.floor(share[:, 0] * _COLUMNS), 0, _COLUMNS - 1).astype(int)
    row = np.clip(np.floor((1 - share[:, 1]) * _ROWS), 0, _ROWS - 1).astype(int)
    return row, column
