"""Detection of recordings that do not fit a map: positions and strains outside the range of the scan."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations
from typing import NamedTuple

import numpy as np

from tactile_localizer.core.scan.range import WARNING_FRACTION, ScanRange
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.io.csv.columns import ANGLES, LENGTHS, fitting_unit
from tactile_localizer.io.recording import Recording, usable
from tactile_localizer.offline.replay import Track
from tactile_localizer.scene import Scene

_MAX_DEVIATIONS = 1e100
"""Limit of a deviation in standard deviations, whose square would overflow."""

_MIN_SWAP_GAIN = 10.0
"""Gain in log-likelihood from which another order of the phalanges is suggested, nats per sample.

The right order gains over 1,000 on simulated hands.
"""

_MAX_PERMUTED = 6
"""Most phalanges whose orders (720) are all tried."""

_SCALE_HINTS = {1e-3: "1000 times too large: millivolts?", 1e3: "1000 times too small: another unit?"}


class Misfit(NamedTuple):
    """Differences between a recording and the scan.

    Parameters
    ----------
    outside : fraction of the positions outside the scene's bounds
    beyond : fraction of the samples with a channel outside the range of the scan
    left_out : names of the phalanges that are missing or stuck in most samples
    hints : likely causes
    """

    outside: float
    beyond: float
    left_out: tuple[str, ...]
    hints: tuple[str, ...]

    @property
    def positions_fit(self) -> bool:
        """Whether nearly all positions are inside the scene's bounds."""
        return self.outside <= WARNING_FRACTION

    @property
    def line(self) -> str | None:
        """One line for the user; ``None`` if the recording fits."""
        fits = self.positions_fit and self.beyond <= WARNING_FRACTION
        if fits and not self.left_out and not self.hints:
            return None
        parts = [
            f"{self.outside:.0%} of the positions are outside the scene's bounds",
            f"{self.beyond:.0%} of the samples outside the scan's range",
        ]
        if self.left_out:
            parts.append(f"not used: {', '.join(self.left_out)}")
        hints = f" ({'; '.join(self.hints)})" if self.hints else ""
        return f"the recording does not fit the map: {', '.join(parts)}{hints}"


def misfit(
    scan: Scan, scene: Scene, recording: Recording, tracks: Sequence[Track], true_positions: bool
) -> Misfit:
    """Compare a recording with the scan.

    Parameters
    ----------
    scan, scene : scan and scene of the map
    recording : recording as read
    tracks : its replay
    true_positions : whether positions are relative to the material; otherwise they are the arm's, of which
        only differences matter
    """
    scan_range = ScanRange.of(scan, scene)
    positions = np.concatenate([sweep.position for sweep in recording.sweeps])
    strain = np.concatenate([sweep.strain for sweep in recording.sweeps])
    present = np.concatenate([usable(sweep.status) for sweep in recording.sweeps])
    outside = _outside(recording, scene, scan_range, true_positions)
    beyond = float(np.mean(scan_range.strains_outside(strain, present))) if len(strain) else 0.0
    hints = []
    if outside > WARNING_FRACTION:
        hints += _position_hints(positions, scene)
    complete = strain[np.isfinite(strain).all(axis=1)]
    if len(complete):
        scanned = scan.strain_on(scene)
        hints += _strain_hints(complete, scanned, scene, scan_range, beyond)
    return Misfit(outside, beyond, _left_out(scene, recording, tracks), tuple(hints))


def _outside(recording: Recording, scene: Scene, scan_range: ScanRange, true_positions: bool) -> float:
    """Fraction of the positions outside the scene's bounds; an arm's are relative to the first of a sweep."""
    if not len(recording):
        return 0.0
    parts = []
    for sweep in recording.sweeps:
        if true_positions:
            beyond = (sweep.position < scene.lower) | (sweep.position > scene.upper)
            parts.append((beyond & ~scene.wraps).any(axis=1))
        elif len(sweep):
            parts.append(scan_range.positions_outside(sweep.position, sweep.position[0]))
    return float(np.mean(np.concatenate(parts)))


def _position_hints(positions: np.ndarray, scene: Scene) -> list[str]:
    """Units in which the positions would be inside the bounds."""
    hints = []
    for axis, values in zip(scene.axes, positions.T, strict=True):
        found = fitting_unit(axis, values, ANGLES if axis.name == "yaw" else LENGTHS)
        if found is not None:
            hints.append(f"{axis.name} in {found[0]}?")
    return hints or ["another piece of material, or another origin?"]


def _strain_hints(
    strain: np.ndarray, scanned: np.ndarray, scene: Scene, scan_range: ScanRange, beyond: float
) -> list[str]:
    """A unit of the strain or an order of the phalanges that fits much better."""
    every = np.ones(len(scene.phalanges), dtype=bool)
    spread = np.maximum(_spread(scanned), 1e-300)
    for factor, text in _SCALE_HINTS.items():
        ratio = float(np.median(factor * _spread(strain) / spread))
        scaled = float(np.mean(scan_range.strains_outside(factor * strain, every)))
        if 0.1 < ratio < 10.0 and scaled <= max(beyond, WARNING_FRACTION):
            return [f"strains are {text}"]
    order = _best_order(strain, scanned, scene)
    if order is not None:
        expected = ", ".join(scene.phalanx_names)
        return [f"phalanges swapped: {', '.join(order)} in the columns of {expected}?"]
    return ["another material, force or tare?"] if beyond > WARNING_FRACTION else []


def _spread(strain: np.ndarray) -> np.ndarray:
    """Robust standard deviation (C,): half the distance between the 16 and 84 % quantiles."""
    low, high = np.quantile(strain, (0.16, 0.84), axis=0)
    return np.asarray(0.5 * (high - low))


def _best_order(strain: np.ndarray, scanned: np.ndarray, scene: Scene) -> tuple[str, ...] | None:
    """Order of the phalanges that explains the columns better than the given one, if any."""
    slices, names = scene.layout.slices, scene.phalanx_names
    count = len(slices)
    if not 2 <= count <= _MAX_PERMUTED:
        return None
    scores = np.array([[_score(strain[:, of], scanned[:, by]) for by in slices] for of in slices])
    totals = {order: float(scores[range(count), order].sum()) for order in permutations(range(count))}
    best = max(totals, key=totals.__getitem__)
    gain = totals[best] - totals[tuple(range(count))]
    return tuple(names[index] for index in best) if gain > _MIN_SWAP_GAIN else None


def _score(strain: np.ndarray, scanned: np.ndarray) -> float:
    """Mean log-density of samples (n, c) under the normal distribution of the scan's samples, nats."""
    if strain.shape[1] != scanned.shape[1]:
        return -np.inf
    covariance = np.atleast_2d(np.cov(scanned.T))
    covariance += np.diag(0.01 * np.diag(covariance) + 1e-300)
    root = np.linalg.cholesky(covariance)
    scaled = np.linalg.solve(root, (strain - scanned.mean(axis=0)).T).clip(-_MAX_DEVIATIONS, _MAX_DEVIATIONS)
    return float(-0.5 * np.mean(np.sum(scaled**2, axis=0)) - np.log(np.diag(root)).sum())


def _left_out(scene: Scene, recording: Recording, tracks: Sequence[Track]) -> tuple[str, ...]:
    """Phalanges that are missing or stuck in most samples."""
    present = np.concatenate([usable(sweep.status) for sweep in recording.sweeps])
    consistent = np.concatenate([track.consistent for track in tracks])
    used = np.ones(len(scene.phalanges))
    for flags in (present, consistent):
        if len(flags):
            used = np.minimum(used, flags.mean(axis=0))
    return tuple(name for name, fraction in zip(scene.phalanx_names, used, strict=True) if fraction < 0.5)
