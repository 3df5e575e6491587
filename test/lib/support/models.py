"""Measurement models known in closed form."""

import math

import numpy as np
from scipy.special import logsumexp

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.filters.base import BayesFilter
from tactile_localizer.core.filters.belief import Belief
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.core.likelihood.noise_model import NoiseModel, WhitenedScan
from tactile_localizer.core.likelihood.white_noise import WhiteNoise
from tactile_localizer.core.scan.interpolation import hold_out
from tactile_localizer.core.scan.lines import line_spacing
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.tracks import Tracks
from tactile_localizer.scene import Scene


def noise_model(
    layout: ChannelLayout,
    width: float = 1.0,
    centre: float = 0.0,
    level_variance: float = 0.0,
    turning: np.ndarray | float = 0.0,
) -> NoiseModel:
    """Independent channels whose visits deviate by ``width`` V from ``centre``."""
    size = layout.size
    white = WhiteNoise(np.array([0.0, 1.0]), np.full((2, size), width**2))
    return NoiseModel(
        layout,
        np.full(size, centre),
        np.eye(size) / width,
        np.eye(size) * width,
        np.full(size, width**2),
        -np.log(width) * np.array(layout.counts),
        np.full(size, level_variance),
        np.broadcast_to(turning, size),
        white,
    )


def whitened_scan(scan: Scan, scene: Scene) -> WhitenedScan:
    """A scan of a sheet with noise of 1 V, of which every strain is signal."""
    tracks = Tracks.of(scan, scene)
    spacing, levels = line_spacing(tracks), np.zeros((len(tracks), scene.layout.size))
    noise, strain = noise_model(scene.layout), tracks.strain
    return WhitenedScan(
        tracks, spacing, hold_out(tracks, spacing), Material.SHEET, noise, levels, strain, strain
    )


class LinearModel:
    """Strain is linear in the state plus white noise: with Gaussian motion, the Kalman filter is exact.

    Parameters
    ----------
    gain : (8F, d) V/m
    std : V
    """

    def __init__(self, gain: np.ndarray, std: float) -> None:
        self.gain, self.std = gain, std

    def log_likelihood(self, states, strain):
        residual = (states @ self.gain.T - strain) / self.std
        constant = -0.5 * len(strain) * math.log(2 * math.pi * self.std**2)
        return constant - 0.5 * np.sum(residual**2, axis=1)


class KalmanFilter:
    """The textbook recursion for :class:`LinearModel`."""

    def __init__(self, mean: np.ndarray, covariance: np.ndarray, model: LinearModel) -> None:
        self.mean, self.covariance, self.model = mean, covariance, model

    def predict(self, displacement: np.ndarray, variance: np.ndarray) -> None:
        self.mean = self.mean + displacement
        self.covariance = self.covariance + np.diag(variance)

    def update(self, strain: np.ndarray) -> float:
        """Update with a measurement; returns the logarithm of its marginal likelihood."""
        H, size = self.model.gain, len(strain)
        innovation = strain - H @ self.mean
        S = H @ self.covariance @ H.T + self.model.std**2 * np.eye(size)
        K = np.linalg.solve(S, H @ self.covariance).T
        self.mean = self.mean + K @ innovation
        self.covariance = self.covariance - K @ H @ self.covariance
        squared = innovation @ np.linalg.solve(S, innovation)
        return float(-0.5 * (squared + np.linalg.slogdet(S)[1] + size * math.log(2 * math.pi)))


def step(
    bayes_filter: BayesFilter,
    model: LinearModel,
    strain: np.ndarray,
    displacement: np.ndarray | None = None,
    travel: float = 0.0,
    injected: float = 0.0,
) -> tuple[Belief, float]:
    """The belief after a motion and a measurement, and the logarithm of the marginal likelihood."""
    dimension = bayes_filter.hypotheses()[0].shape[1]
    moved = np.zeros(dimension) if displacement is None else displacement
    prediction = bayes_filter.predict(moved, travel, injected)
    log_likelihood = model.log_likelihood(prediction.states, strain)
    belief = bayes_filter.update(log_likelihood)
    return belief, float(logsumexp(log_likelihood, b=prediction.weights))


def flat_update(bayes_filter: BayesFilter, log_likelihood: float = 0.0) -> Belief:
    """The belief of a filter, after a measurement that has the same likelihood everywhere."""
    states, _ = bayes_filter.hypotheses()
    prediction = bayes_filter.predict(np.zeros(states.shape[1]), 0.0)
    return bayes_filter.update(np.full(len(prediction.states), log_likelihood))
