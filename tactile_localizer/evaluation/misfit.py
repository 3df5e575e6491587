"""Reasons why a recording cannot fit a map: positions and strains that the scan never had."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations
from typing import NamedTuple

import numpy as np

from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.evaluation.replay import Track
from tactile_localizer.io.csv.columns import ANGLES, LENGTHS, fitting_unit
from tactile_localizer.io.recording import Recording, usable
from tactile_localizer.scene import Scene

_MARGIN = 0.25
"""Share of a channel's range in the scan by which a strain may exceed it."""
_MANY = 0.2
"""Share of positions or strains from which a recording does not fit. None on nine simulated sessions that
fit, at most 0.17 over a foreign seam, all in another unit."""
_SWAPPED = 10.0
"""Nats per measurement by which another order of the phalanges must explain the strains better. Over 1,000 in
favour of the right one on simulated hands."""
_MOST_PHALANGES = 6
"""Phalanges of which all orders are tried, 720."""
_SCALES = {1e-3: "1000 times too large: millivolts?", 1e3: "1000 times too small: another unit?"}


class Misfit(NamedTuple):
    """How a recording differs from the scan.

    Parameters
    ----------
    outside : share of the positions out of the scene's bounds
    unfelt : share of the strains with a channel beyond the range of the scan
    left_out : names of the phalanges that no strain was used of, or that were stuck
    hints : what that usually means
    """

    outside: float
    unfelt: float
    left_out: tuple[str, ...]
    hints: tuple[str, ...]

    @property
    def line(self) -> str | None:
        """One line for a person; ``None`` where the recording fits."""
        if self.outside < _MANY and self.unfelt < _MANY and not self.left_out and not self.hints:
            return None
        parts = [
            f"{self.outside:.0%} of the positions are out of the scene's bounds",
            f"{self.unfelt:.0%} of the strains out of the scan's range",
        ]
        if self.left_out:
            parts.append(f"left out: {', '.join(self.left_out)}")
        hints = f" ({'; '.join(self.hints)})" if self.hints else ""
        return f"the recording does not fit the map: {', '.join(parts)}{hints}"


def misfit(
    scan: Scan, scene: Scene, recording: Recording, tracks: Sequence[Track], true_positions: bool
) -> Misfit:
    """Compare a recording with the scan.

    Parameters
    ----------
    scan, scene : the map
    recording : as it was read
    tracks : its replay
    true_positions : whether the positions are those on the material, rather than the arm's own, of which
        only the differences count
    """
    positions = np.concatenate([_placed(sweep.position, scene, true_positions) for sweep in recording.sweeps])
    strain = np.concatenate([sweep.strain for sweep in recording.sweeps])
    strain = strain[np.isfinite(strain).all(axis=1)]
    felt = scan.strain[:, scene.channels(scan.phalanges, scan.channels)]
    outside = _outside(positions, scene)
    unfelt = _unfelt(strain, felt)
    hints = []
    if outside >= _MANY:
        hints += _position_hints(positions, scene)
    if len(strain):
        hints += _strain_hints(strain, felt, scene, unfelt)
    return Misfit(outside, unfelt, _left_out(scene, recording, tracks), tuple(hints))


def _placed(position: np.ndarray, scene: Scene, true_positions: bool) -> np.ndarray:
    """Positions that can be compared with the bounds; the arm's are put as near to their middle as can be."""
    if true_positions or not len(position):
        return position
    middle = 0.5 * (position.min(axis=0) + position.max(axis=0))
    return position - middle + 0.5 * (scene.lower + scene.upper)


def _outside(positions: np.ndarray, scene: Scene) -> float:
    if not len(positions):
        return 0.0
    beyond = (positions < scene.lower) | (positions > scene.upper)
    return float(np.mean((beyond & ~scene.wraps).any(axis=1)))


def _unfelt(strain: np.ndarray, felt: np.ndarray) -> float:
    """Share of strains (n, C) with a channel beyond the range of those felt in the scan."""
    if not len(strain):
        return 0.0
    low, high = felt.min(axis=0), felt.max(axis=0)
    margin = _MARGIN * (high - low)
    return float(np.mean(((strain < low - margin) | (strain > high + margin)).any(axis=1)))


def _position_hints(positions: np.ndarray, scene: Scene) -> list[str]:
    """Units in which axes that are out of their bounds would lie inside."""
    hints = []
    for axis, values in zip(scene.axes, positions.T, strict=True):
        found = fitting_unit(axis, values, ANGLES if axis.name == "yaw" else LENGTHS)
        if found is not None:
            hints.append(f"{axis.name} in {found[0]}?")
    return hints or ["another piece of material, or another origin?"]


def _strain_hints(strain: np.ndarray, felt: np.ndarray, scene: Scene, unfelt: float) -> list[str]:
    """Another unit of the strain, or another order of the phalanges, that fits far better."""
    spread = np.maximum(felt.std(axis=0), 1e-300)
    for factor, text in _SCALES.items():
        ratio = float(np.median(factor * strain.std(axis=0) / spread))
        if 0.1 < ratio < 10.0 and _unfelt(factor * strain, felt) < max(unfelt, _MANY):
            return [f"strains are {text}"]
    order = _best_order(strain, felt, scene)
    if order is not None:
        expected = ", ".join(scene.phalanx_names)
        return [f"phalanges swapped: {', '.join(order)} in the columns of {expected}?"]
    return ["another material, force or tare?"] if unfelt >= _MANY else []


def _best_order(strain: np.ndarray, felt: np.ndarray, scene: Scene) -> tuple[str, ...] | None:
    """Names of the phalanges whose columns these really are, where that is another order."""
    slices, names = scene.layout.slices, scene.phalanx_names
    count = len(slices)
    if not 2 <= count <= _MOST_PHALANGES:
        return None
    scores = np.array([[_score(strain[:, of], felt[:, by]) for by in slices] for of in slices])
    totals = {order: float(scores[range(count), order].sum()) for order in permutations(range(count))}
    best = max(totals, key=totals.__getitem__)
    gain = totals[best] - totals[tuple(range(count))]
    return tuple(names[index] for index in best) if gain > _SWAPPED else None


def _score(strain: np.ndarray, felt: np.ndarray) -> float:
    """Mean log-density of strains (n, c) under the normal distribution of those felt in the scan, nats."""
    if strain.shape[1] != felt.shape[1]:
        return -np.inf
    covariance = np.atleast_2d(np.cov(felt.T))
    covariance += np.diag(0.01 * np.diag(covariance) + 1e-300)
    root = np.linalg.cholesky(covariance)
    scaled = np.linalg.solve(root, (strain - felt.mean(axis=0)).T)
    return float(-0.5 * np.mean(np.sum(scaled**2, axis=0)) - np.log(np.diag(root)).sum())


def _left_out(scene: Scene, recording: Recording, tracks: Sequence[Track]) -> tuple[str, ...]:
    """Phalanges that are missing or stuck in most samples."""
    present = np.concatenate([usable(sweep.status) for sweep in recording.sweeps])
    consistent = np.concatenate([track.consistent for track in tracks])
    used = np.ones(len(scene.phalanges))
    for flags in (present, consistent):
        if len(flags):
            used = np.minimum(used, flags.mean(axis=0))
    return tuple(name for name, share in zip(scene.phalanx_names, used, strict=True) if share < 0.5)
