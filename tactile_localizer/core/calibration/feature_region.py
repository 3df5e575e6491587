"""Proposal of the feature's region (the paper's Gamma) from a scan.

The noise model sets the strains of a phalanx to zero where they are not reproducible in neighbouring sweeps
(:mod:`~tactile_localizer.core.likelihood.noise_model`). The region is the bounding box of the places with
other strains. Material that has features everywhere, such as woven cloth, has no region.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from tactile_localizer.core.geometry.phalanges import phalanx_positions
from tactile_localizer.core.likelihood.noise_model import estimate_noise
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Region, Scene

_CELLS = 24
"""Cells along each axis."""
_FEWEST_SWEEPS = 3
"""Sweeps that must have a signal at neighbouring places; that of a single sweep may be chance."""


@dataclass(frozen=True)
class Proposal:
    """A region and the cells from which it was derived.

    Parameters
    ----------
    region : box in phalanx coordinates; ``None`` if the material has features everywhere or nowhere
    cells : one entry per phalanx, (cells, ...) bool, whether it has a signal
    axes : one entry per phalanx, centres of the cells along each axis, m (yaw: rad)
    """

    region: Region | None
    cells: list[np.ndarray]
    axes: list[list[np.ndarray]]


def propose_region(scan: Scan, scene: Scene) -> Proposal:
    """Propose the region in which the phalanges can touch the feature; that of ``scene`` is ignored.

    Raises
    ------
    SceneError
        The scene names an axis or a phalanx that the scan does not have.
    """
    estimate = estimate_noise(scan, replace(scene, feature=None))
    positions = np.concatenate([track.positions for track in estimate.tracks])
    strain = np.concatenate([track.strain for track in estimate.tracks])
    sweep = np.repeat(np.arange(len(estimate.tracks)), [len(track.strain) for track in estimate.tracks])
    fewest = min(_FEWEST_SWEEPS, len(estimate.tracks))
    cells, axes, boxes = [], [], []
    for phalanx, own in zip(scene.phalanges, scene.layout.slices, strict=True):
        signal = np.any(strain[:, own] != 0.0, axis=1)
        index, centres = _cells(phalanx_positions(scene, phalanx, positions))
        group, own_cells = _largest_group(index, signal)
        cells.append(own_cells)
        axes.append(centres)
        sweeps = np.unique(sweep[signal & group[index]])
        if estimate.featureless and len(sweeps) >= fewest and not own_cells.all():
            boxes.append(_box(group, centres))
    if not boxes:
        return Proposal(None, cells, axes)
    turn = np.where(scene.wraps, np.pi, np.inf)  # the bounds of the yaw of a phalanx
    region = Region(
        tuple(map(float, np.maximum(np.min([low for low, _ in boxes], axis=0), -turn))),
        tuple(map(float, np.minimum(np.max([high for _, high in boxes], axis=0), turn))),
    )
    return Proposal(region, cells, axes)


def _cells(positions: np.ndarray) -> tuple[tuple[np.ndarray, ...], list[np.ndarray]]:
    """Index of the cell of each position (n, d), and the centres of the cells along each axis."""
    low, high = positions.min(axis=0), positions.max(axis=0)
    size = np.maximum(high - low, 1e-300) / _CELLS
    index = np.minimum(((positions - low) / size).astype(int), _CELLS - 1)
    return tuple(index.T), [low[axis] + size[axis] * (np.arange(_CELLS) + 0.5) for axis in range(len(size))]


def _largest_group(index: tuple[np.ndarray, ...], signal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Largest connected group of cells with a signal at most of their positions, and all such cells."""
    total = np.zeros((_CELLS,) * len(index))
    inside = total.copy()
    np.add.at(total, index, 1.0)
    np.add.at(inside, index, signal)
    cells = inside > 0.5 * np.maximum(total, 1.0)
    cells |= ndimage.binary_closing(cells)  # fills cells between sweeps
    labels, _ = ndimage.label(cells)
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    return (labels == sizes.argmax()) & cells, cells


def _box(group: np.ndarray, centres: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of a group of cells, with a margin of one cell."""
    places = np.argwhere(group)
    size = np.array([c[1] - c[0] for c in centres])
    low = np.array([c[i] for c, i in zip(centres, places.min(axis=0), strict=True)]) - 1.5 * size
    high = np.array([c[i] for c, i in zip(centres, places.max(axis=0), strict=True)]) + 1.5 * size
    return low, high
