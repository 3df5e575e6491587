"""A phalanx load cell: contact wrench to eight strain voltages (paper, Sec. II-A), or another sensor.

Four bars carry the cap; each has two pairs of strain gauges, one for bending out of the cap's plane
and one for bending along its rim. Strain is affine in the wrench, with full rank, and never calibrated.
A sensor with another number of channels is affine in the wrench too, each channel in a direction of its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_localizer.channels import DEFAULT_CHANNELS

_BAR_ANGLES_RAD = np.radians([15.0, 100.0, 200.0, 290.0])
_BAR_RADIUS_M = 6.0e-3
_OUT_OF_PLANE_V_PER_N = 0.5
_ALONG_RIM_V_PER_N = 0.45
_CROSSTALK = 0.15
_TOLERANCE = 0.08
_BIAS_V = 0.2

NOISE_V = 3e-3
"""White noise of one gauge pair, one sigma, V."""

DRIFT_V = 2e-3
"""Size of a gauge pair's slow drift, one sigma, V, over minutes."""

_DRIFT_PERIODS_S = (130.0, 410.0, 1300.0)


@dataclass(frozen=True)
class LoadCell:
    """One load cell, or another sensor of c channels.

    Parameters
    ----------
    gain : (c, 6) V per N and V per N m, of the wrench (Fx, Fy, Fz, Mx, My, Mz) at the cell's centre
    bias : (c,) V, unloaded
    """

    gain: np.ndarray
    bias: np.ndarray

    def strain(self, wrench: np.ndarray) -> np.ndarray:
        """Voltages (n, c) without noise, of ``wrench`` (n, 6)."""
        return np.asarray(wrench @ self.gain.T + self.bias)


def load_cell(serial: int) -> LoadCell:
    """The cell with this serial number: each is built alike and comes out a little different."""
    rng = np.random.default_rng(serial)
    angle = _BAR_ANGLES_RAD + rng.normal(0, np.radians(3), 4)
    cos, sin = np.cos(angle), np.sin(angle)
    zero, one = np.zeros(4), np.ones(4)
    lever = 1 / (2 * _BAR_RADIUS_M)
    out_of_plane = np.stack([zero, zero, one / 4, lever * sin, -lever * cos, zero], axis=1)
    along_rim = np.stack([-sin / 2, cos / 2, zero, zero, zero, one * lever / 2], axis=1)
    gain = np.empty((8, 6))
    gain[0::2] = _OUT_OF_PLANE_V_PER_N * (out_of_plane + _CROSSTALK * along_rim)
    gain[1::2] = _ALONG_RIM_V_PER_N * (along_rim + _CROSSTALK * out_of_plane)
    gain *= 1 + _TOLERANCE * rng.standard_normal(gain.shape)
    return LoadCell(gain, rng.uniform(-_BIAS_V, _BIAS_V, 8))


def sensor(serial: int, channels: int) -> LoadCell:
    """A sensor with so many channels: the load cell of this serial number where it has as many as that."""
    if channels == DEFAULT_CHANNELS:
        return load_cell(serial)
    rng = np.random.default_rng([serial, channels])
    direction = rng.standard_normal((channels, 6))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    lever = 1 / (2 * _BAR_RADIUS_M)
    gain = _OUT_OF_PLANE_V_PER_N * direction * [0.5, 0.5, 0.5, lever, lever, lever]
    return LoadCell(gain, rng.uniform(-_BIAS_V, _BIAS_V, channels))


def drift(rng: np.random.Generator, time_s: np.ndarray, gauges: int) -> np.ndarray:
    """Slow drift (n, gauges), V, at ``time_s`` (n,); one course for one state of ``rng``."""
    phase = rng.uniform(0, 2 * np.pi, (len(_DRIFT_PERIODS_S), 1, gauges))
    size = rng.standard_normal((len(_DRIFT_PERIODS_S), 1, gauges))
    turn = 2 * np.pi * time_s[:, None] / np.reshape(_DRIFT_PERIODS_S, (-1, 1, 1))
    return np.asarray(
        DRIFT_V * np.sqrt(2 / len(_DRIFT_PERIODS_S)) * np.sum(size * np.sin(turn + phase), axis=0)
    )
