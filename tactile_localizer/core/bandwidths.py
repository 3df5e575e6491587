"""Kernel widths S_x and S_z chosen by what they predict: leave-one-sweep-out likelihood (paper, III-C, sets them by hand)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from tactile_localizer.core.background import Background
from tactile_localizer.core.sum_of_gaussians import FLOOR
from tactile_localizer.scene import GAUGES

_REACH = 4.0
"""Largest position widths within which candidates are gathered, in multiples of the starting width."""
_MOST_CANDIDATES = 1_500_000
"""Pairs of query and candidate held at once: 16 channels of them in float32 are 100 MB."""


@dataclass(frozen=True)
class Bandwidths:
    """Kernel widths and how well they predict.

    ``position_std`` (d,) m (yaw: rad), ``strain_std`` (8F,) V, and ``score``: mean log-density of held-out
    strains given their positions, nats a sample.
    """

    position_std: np.ndarray
    strain_std: np.ndarray
    score: float


class LeaveOneSweepOut:
    """Predictive log-likelihood of held-out sweeps as a function of the kernel widths.

    Parameters
    ----------
    positions, strain, sweep : (N, d), (N, 8F) and (N,), the scan; a scan of one sweep is cut into eight
    queries : how many held-out samples to predict, spread evenly over the scan
    """

    def __init__(self, positions: np.ndarray, strain: np.ndarray, sweep: np.ndarray, queries: int = 400) -> None:
        if len(np.unique(sweep)) == 1:
            sweep = np.arange(len(sweep)) * 8 // len(sweep)
        self.start_position = _neighbour_distance(positions, sweep)
        extent = positions.max(axis=0) - positions.min(axis=0)
        reach = np.minimum(_REACH * self.start_position, np.maximum(extent, self.start_position))
        chosen = np.unique(np.linspace(0, len(positions) - 1, queries).astype(int))
        rows, segments = [], []
        for query in chosen:
            near = np.all(np.abs(positions - positions[query]) <= 2.0 * reach, axis=1) & (sweep != sweep[query])
            candidates = np.flatnonzero(near)
            most = _MOST_CANDIDATES // len(chosen)
            if len(candidates) > most:
                candidates = candidates[np.linspace(0, len(candidates) - 1, most).astype(int)]
            if len(candidates):
                rows.append(candidates)
                segments.append(query)
        counts = np.array([len(r) for r in rows])
        query_of = np.repeat(segments, counts)
        candidate = np.concatenate(rows)
        self._starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
        self._counts = counts
        self._segment = np.repeat(np.arange(len(counts)), counts)
        self._position_sq = ((positions[candidate] - positions[query_of]) ** 2).T
        difference = (strain[candidate] - strain[query_of]).astype(np.float32)
        self._strain_sq = np.ascontiguousarray((difference**2).T)
        nearest = np.array([
            np.sqrt(np.median(self._strain_sq[c])) for c in range(strain.shape[1])
        ])
        self.start_strain = 0.5 * np.maximum(nearest, 1e-6 * np.ptp(strain, axis=0) + np.finfo(float).tiny)
        background = Background(strain, self.start_strain)
        present = np.ones(strain.shape[1] // GAUGES, dtype=bool)
        self._log_background = np.array([background.log_density(strain[q], present) for q in segments])
        self._total = len(positions)
        self._extent = extent

    def score(self, position_std: np.ndarray, strain_std: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Mean log-density a sample, nats, and its gradients with respect to the logarithms of the widths."""
        position_term = self._position_sq.T @ (1.0 / position_std**2)
        strain_term = (1.0 / strain_std**2).astype(np.float32) @ self._strain_sq
        log_kernel = -0.5 * position_term
        log_joint = log_kernel - 0.5 * strain_term
        peak = np.maximum.reduceat(log_joint, self._starts)
        joint = np.exp(log_joint - peak[self._segment])
        kernel = np.exp(log_kernel)
        log_constant = -0.5 * len(strain_std) * math.log(2 * math.pi) - np.log(strain_std).sum()
        log_sum = np.log(np.add.reduceat(joint, self._starts)) + peak + log_constant
        density = np.add.reduceat(kernel, self._starts)
        width = position_std * math.sqrt(2 * math.pi)
        floor = FLOOR * self._total * float(np.prod(width / np.maximum(self._extent, width)))
        log_floor = math.log(floor) + self._log_background
        log_total = np.logaddexp(log_sum, log_floor)
        score = float(np.mean(log_total - np.log(density + floor)))
        share = np.exp(log_sum - log_total)
        # Responsibilities of the candidates, and of the position kernel alone.
        responsibility = joint * (share / np.add.reduceat(joint, self._starts))[self._segment]
        alone = kernel / (density + floor)[self._segment]
        n = len(self._starts)
        strain_gradient = (self._strain_sq @ responsibility.astype(np.float32)) / strain_std**2 / n - share.mean()
        position_gradient = (self._position_sq @ (responsibility - alone)) / position_std**2 / n
        position_gradient += np.mean((1 - share) - floor / (density + floor))
        return score, position_gradient, strain_gradient


def choose_bandwidths(positions: np.ndarray, strain: np.ndarray, sweep: np.ndarray, queries: int = 400) -> Bandwidths:
    """Widths that predict held-out sweeps best, by gradient ascent on their logarithms."""
    held_out = LeaveOneSweepOut(positions, strain, sweep, queries)
    d = positions.shape[1]
    start = np.log(np.concatenate([held_out.start_position, held_out.start_strain]))

    def objective(parameters: np.ndarray) -> tuple[float, np.ndarray]:
        widths = np.exp(parameters)
        score, position_gradient, strain_gradient = held_out.score(widths[:d], widths[d:])
        return -score, -np.concatenate([position_gradient, strain_gradient])

    span = np.concatenate([np.full(d, math.log(4.0)), np.full(len(start) - d, math.log(30.0))])
    # Not wider in position than candidates were gathered for.
    found = minimize(
        objective, start, jac=True, method="L-BFGS-B", bounds=np.stack([start - span, start + span], axis=1), options={"maxiter": 60}
    )
    widths = np.exp(found.x)
    return Bandwidths(widths[:d], widths[d:], -float(found.fun))


def _neighbour_distance(positions: np.ndarray, sweep: np.ndarray) -> np.ndarray:
    """Typical distance, an axis, from a pair to the nearest pair of another sweep (median of axis distances)."""
    from scipy.spatial import cKDTree

    step = max(1, len(positions) // 300)
    extent = np.maximum(np.ptp(positions, axis=0), np.finfo(float).tiny)
    distances = []
    for number in np.unique(sweep):
        others = positions[sweep != number]
        own = positions[sweep == number][::step]
        if len(own):
            distances.append(np.linalg.norm((others[cKDTree(others / extent).query(own / extent)[1]] - own) / extent, axis=1))
    typical = float(np.median(np.concatenate(distances)))
    return np.maximum(typical, 1e-3) * extent
