"""Load cell of a phalanx: converts a contact wrench to strain voltages (paper, Sec. II-A).

Four bars carry the cap; each has two pairs of strain gauges, one for bending out of the cap's plane and
one for bending along its rim. The strain is an affine function of the wrench with full rank, and is not
calibrated. A sensor with a different number of channels is affine in the wrench as well, with a random
direction for each channel.
"""

from dataclasses import dataclass

import numpy as np

from tactile_localizer.channels import DEFAULT_CHANNELS

_BAR_ANGLES_RAD = np.radians([15.0, 100.0, 200.0, 290.0])
_BAR_RADIUS_M = 6.0e-3
"""Angles of the bars around the cap, and their distance from its centre."""

_OUT_OF_PLANE_V_PER_N = 0.5
_ALONG_RIM_V_PER_N = 0.45
"""Sensitivity of the two gauge pairs of a bar."""

_CROSSTALK = 0.15
"""Sensitivity of a gauge pair to bending in the other direction, relative to its own."""

_GAIN_TOLERANCE = 0.08
"""Relative standard deviation of a gain between load cells."""

_MAX_BIAS_V = 0.2
"""Largest voltage of an unloaded gauge pair, V."""

NOISE_V = 3e-3
"""Standard deviation of the white noise of a gauge pair, V."""

DRIFT_V = 2e-3
"""Standard deviation of the slow drift of a gauge pair over minutes, V."""

_DRIFT_PERIODS_S = (130.0, 410.0, 1300.0)
"""Periods of the sine waves that make up the drift, s."""


@dataclass(frozen=True)
class LoadCell:
    """A load cell, or another sensor with c channels.

    Parameters
    ----------
    gain : (c, 6) V/N and V/(N m), for the wrench (Fx, Fy, Fz, Mx, My, Mz) at the centre of the cell
    bias : (c,) voltages of the unloaded cell, V
    """

    gain: np.ndarray
    bias: np.ndarray

    def strain(self, wrench: np.ndarray) -> np.ndarray:
        """Voltages (n, c) without noise for ``wrench`` (n, 6)."""
        return np.asarray(wrench @ self.gain.T + self.bias)


def load_cell(serial: int) -> LoadCell:
    """Load cell with a serial number, which determines the deviations from the nominal design."""
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
    gain *= 1 + _GAIN_TOLERANCE * rng.standard_normal(gain.shape)
    return LoadCell(gain, rng.uniform(-_MAX_BIAS_V, _MAX_BIAS_V, 8))


def sensor(serial: int, channels: int) -> LoadCell:
    """Sensor with a number of channels; the load cell with this serial number if it is the default one."""
    if channels == DEFAULT_CHANNELS:
        return load_cell(serial)
    rng = np.random.default_rng([serial, channels])
    direction = rng.standard_normal((channels, 6))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    lever = 1 / (2 * _BAR_RADIUS_M)
    gain = _OUT_OF_PLANE_V_PER_N * direction * [0.5, 0.5, 0.5, lever, lever, lever]
    return LoadCell(gain, rng.uniform(-_MAX_BIAS_V, _MAX_BIAS_V, channels))


def drift(rng: np.random.Generator, time_s: np.ndarray, gauges: int) -> np.ndarray:
    """Slow drift (n, gauges), V, at ``time_s`` (n,), determined by the state of ``rng``."""
    phase = rng.uniform(0, 2 * np.pi, (len(_DRIFT_PERIODS_S), 1, gauges))
    amplitude = rng.standard_normal((len(_DRIFT_PERIODS_S), 1, gauges))
    angle = 2 * np.pi * time_s[:, None] / np.reshape(_DRIFT_PERIODS_S, (-1, 1, 1))
    return np.asarray(
        DRIFT_V * np.sqrt(2 / len(_DRIFT_PERIODS_S)) * np.sum(amplitude * np.sin(angle + phase), axis=0)
    )
