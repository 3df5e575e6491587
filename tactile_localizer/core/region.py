"""The feature's region (the paper's Gamma) proposed from the data, where a scene does not give it.

Featureless material is what most of a phalanx's strains have in common: a tight cluster, found robustly. Each
sweep has its own offset (grip, temperature, tare), so a sweep is taken relative to its own tightest cluster.
The region is the box around the places where the strain leaves that of all sweeps together. Material that is
featured everywhere, such as woven cloth, has a cluster too; whether what lies outside a proposed box is
featureless is for held-out sweeps to say (:mod:`~.region_confidence`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree
from scipy.stats import chi2

from tactile_localizer.core.likelihood.kernels.normal import Normal
from tactile_localizer.core.likelihood.sum_of_gaussians import training_pairs
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Region, Scene

_CORE = 0.25
"""Share of a phalanx's strains that is surely featureless where a feature can be told at all."""
_STARTS = 30
_SUBSAMPLE = 1500
_INSIDE = 1.0 - 1e-6
"""Probability of a normal cluster within which strains count as featureless; beyond it they touch
something."""
_FAR = 6.0
"""Median deviations from most sweeps beyond which a sweep is not known to leave the feature."""
_CELLS = 24


@dataclass(frozen=True)
class Proposal:
    """A region and what speaks for it.

    Parameters
    ----------
    region : box in phalanx coordinates; ``None`` where the material is featured everywhere or nowhere
    cells : one entry a phalanx, (cells, ...) bool, where the strain leaves the featureless cluster
    axes : one entry a phalanx, centres of the cells along each axis, m (yaw: rad)
    """

    region: Region | None
    cells: list[np.ndarray]
    axes: list[list[np.ndarray]]


def propose_region(scan: Scan, scene: Scene) -> Proposal:
    """Where the phalanges can touch the feature, from a scan of ``scene``."""
    positions, strain = training_pairs(scan, scene)
    cells, axes = [], []
    for phalanx, columns in zip(scene.phalanges, scene.layout.slices, strict=True):
        own = without_offsets(strain[:, columns], scan.sweep)
        cluster = featureless_cluster(own)
        squared = cluster.squared_distance(own)
        touched, centres = _touched_cells(positions + np.asarray(phalanx.offset), squared, phalanx.channels)
        cells.append(touched)
        axes.append(centres)
    boxes = [box for box in map(_box, cells, axes) if box is not None]
    if not boxes:
        return Proposal(None, cells, axes)
    turn = np.where(scene.wraps, np.pi, np.inf)  # a phalanx's angle lies within half a turn of 0
    region = Region(
        tuple(map(float, np.maximum(np.min([low for low, _ in boxes], axis=0), -turn))),
        tuple(map(float, np.minimum(np.max([high for _, high in boxes], axis=0), turn))),
    )
    return Proposal(region, cells, axes)


def without_offsets(strain: np.ndarray, sweep: np.ndarray) -> np.ndarray:
    """Strains (N, c), V, of sweeps (N,) relative to the most common strain of their own sweep.

    A sweep whose most common strain is far from that of most sweeps may lie on the feature all along: it is
    taken relative to theirs.
    """
    numbers, index = np.unique(sweep, return_inverse=True)
    common = np.stack([featureless_cluster(strain[sweep == number]).mean for number in numbers])
    middle = np.median(common, axis=0)
    spread = np.median(np.abs(common - middle), axis=0)
    far = np.square(common - middle).mean(axis=1) > _FAR**2 * np.square(spread).mean()
    return strain - np.where(far[:, None], middle, common)[index]


def featureless_cluster(strain: np.ndarray) -> Normal:
    """Location and scatter of the tightest cluster of strains (N, c), by the minimum covariance determinant.

    Concentration steps from several starts (Rousseeuw and Van Driessen, 1999) on a quarter of the samples.
    """
    sample = strain[np.unique(np.linspace(0, len(strain) - 1, _SUBSAMPLE).astype(int))]
    channels = strain.shape[1]
    size = max(channels + 2, int(_CORE * len(sample)))
    if len(sample) <= size:
        return Normal.fitted(sample)
    spread = sample.std(axis=0)
    scaled = (sample - sample.mean(axis=0)) / np.where(
        spread > 1e-9 * np.abs(sample).max(axis=0), spread, 1.0
    )
    tree = cKDTree(scaled)
    best, least = None, np.inf
    for start in np.unique(np.linspace(0, len(sample) - 1, _STARTS).astype(int)):
        rows = tree.query(scaled[start], k=size)[1]
        for _ in range(5):
            cluster = Normal.fitted(sample[rows])
            rows = np.argpartition(cluster.squared_distance(sample), size - 1)[:size]
        determinant = float(np.linalg.slogdet(np.cov(scaled[rows].T) + 1e-12 * np.eye(channels))[1])
        if determinant < least:
            best, least = rows, determinant
    assert best is not None
    core = Normal.fitted(sample[best])
    # The innermost quarter is tighter than the whole cluster, by the ratio of its radius to a normal one's.
    inner = float(np.quantile(core.squared_distance(sample), _CORE)) / float(chi2.ppf(_CORE, channels))
    return Normal(core.mean, core.covariance * (inner or 1.0))


def _touched_cells(
    positions: np.ndarray, squared: np.ndarray, channels: int
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Cells of phalanx positions in which most strains lie outside the cluster, without lone specks."""
    low, high = positions.min(axis=0), positions.max(axis=0)
    size = np.maximum(high - low, 1e-300) / _CELLS
    place = np.minimum(((positions - low) / size).astype(int), _CELLS - 1)
    shape = (_CELLS,) * positions.shape[1]
    flat = np.ravel_multi_index(tuple(place.T), shape)
    outside = np.bincount(flat, weights=squared > chi2.ppf(_INSIDE, channels), minlength=_CELLS ** len(shape))
    total = np.bincount(flat, minlength=_CELLS ** len(shape))
    touched = (outside > 0.5 * np.maximum(total, 1)).reshape(shape)
    # Cells that no sweep crossed belong with their neighbours.
    touched = ndimage.binary_closing(touched, iterations=1) | touched
    centres = [low[axis] + size[axis] * (np.arange(_CELLS) + 0.5) for axis in range(len(shape))]
    return touched, centres


def _box(touched: np.ndarray, centres: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray] | None:
    """Bounds of the largest connected group of touched cells, with a cell to spare on every side."""
    labels, count = ndimage.label(touched)
    if count == 0 or touched.all():
        return None
    largest = 1 + int(np.argmax(np.bincount(labels.ravel())[1:]))
    places = np.argwhere(labels == largest)
    size = np.array([c[1] - c[0] for c in centres])
    low = np.array([c[i] for c, i in zip(centres, places.min(axis=0), strict=True)]) - 1.5 * size
    high = np.array([c[i] for c, i in zip(centres, places.max(axis=0), strict=True)]) + 1.5 * size
    return low, high
