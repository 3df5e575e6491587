"""Particle filters of other packages for :mod:`peers`, used as documented, on one plain model."""

from __future__ import annotations

import datetime
import math
from typing import Any

import numpy as np
import particles
from filterpy.monte_carlo import systematic_resample
from pfilter import ParticleFilter as PFilter
from pfilter import systematic_resample as pfilter_systematic
from scipy.spatial.distance import cdist
from stonesoup.base import Property
from stonesoup.models.measurement.base import MeasurementModel
from stonesoup.models.transition.base import TransitionModel
from stonesoup.predictor.particle import ParticlePredictor
from stonesoup.resampler.particle import SystematicResampler
from stonesoup.types.array import StateVectors
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.state import ParticleState
from stonesoup.updater.particle import ParticleUpdater

from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Scene

_ROWS = 1000
"""Particles whose kernels to all pairs are in memory at once."""


class PlainModel:
    """Straightforward implementation of the conditional sum of Gaussians with its floor.

    Parameters
    ----------
    scan : training pairs
    position_std, strain_std : kernel widths, m and V
    """

    def __init__(self, scan: Scan, position_std: float, strain_std: float) -> None:
        self._positions, self._strain = scan.states / position_std, scan.strain / strain_std
        self._position_std, self._strain_std = position_std, strain_std
        extent = np.maximum(np.ptp(scan.states, axis=0), position_std * math.sqrt(2 * math.pi))
        self._floor = 0.01 * len(scan) * float(np.prod(position_std * math.sqrt(2 * math.pi) / extent))
        self._mean, self._scale = (
            scan.strain.mean(axis=0),
            2.0 * np.hypot(scan.strain.std(axis=0), strain_std),
        )

    def log_likelihood(self, states: np.ndarray, strain: np.ndarray) -> np.ndarray:
        """Log-likelihood (P,) of a strain vector (16,) at states (P, 2)."""
        squared = np.sum((self._strain - strain / self._strain_std) ** 2, axis=1)
        nearest = squared.min()
        both = np.stack([np.exp(-0.5 * (squared - nearest)), np.ones(len(squared))], axis=1)
        sums = np.concatenate(
            [
                np.exp(
                    -0.5 * cdist(states[i : i + _ROWS] / self._position_std, self._positions, "sqeuclidean")
                )
                @ both
                for i in range(0, len(states), _ROWS)
            ]
        )
        log_scale = -0.5 * nearest - len(strain) * math.log(self._strain_std * math.sqrt(2 * math.pi))
        with np.errstate(divide="ignore"):
            total = np.logaddexp(np.log(sums[:, 0]) + log_scale, math.log(self._floor) + self._broad(strain))
        return total - np.log(sums[:, 1] + self._floor)

    def _broad(self, strain: np.ndarray) -> float:
        scaled = ((strain - self._mean) / self._scale).reshape(-1, 8)
        constant = math.lgamma(5.5) - math.lgamma(1.5) - 4 * math.log(3 * math.pi)
        return float(np.sum(constant - 5.5 * np.log1p(np.sum(scaled**2, axis=1) / 3))) - float(
            np.log(self._scale).sum()
        )


class Filterpy:
    """filterpy: its resampling in the loop of its book."""

    def __init__(self, model: PlainModel, scene: Scene, count: int) -> None:
        self._model, self._scene, self._count = model, scene, count
        self._rng = np.random.default_rng(0)
        self.spread()

    def spread(self) -> None:
        """Draw uniform particles."""
        self.states = uniform(self._scene, self._count, self._rng)

    def step(self, displacement: np.ndarray, strain: np.ndarray) -> None:
        """Predict, weight, resample."""
        self.states = (
            self.states + displacement + noise(self._scene, displacement, self.states.shape, self._rng)
        )
        log_weights = self._model.log_likelihood(self.states, strain)
        weights = np.exp(log_weights - log_weights.max())
        weights /= weights.sum()
        self.states = self.states[systematic_resample(weights)]


class Particles:
    """particles: a Feynman-Kac model, run step by step by its SMC."""

    class _Slide(particles.FeynmanKac):
        def __init__(self, model: PlainModel, scene: Scene) -> None:
            super().__init__(T=10**9)
            self.model, self.scene = model, scene
            self.rng = np.random.default_rng(0)
            self.displacement, self.strain = np.zeros(2), np.zeros(16)

        def M0(self, N: int) -> np.ndarray:  # noqa: N802
            return uniform(self.scene, N, self.rng)

        def M(self, t: int, xp: np.ndarray) -> np.ndarray:  # noqa: N802
            return xp + self.displacement + noise(self.scene, self.displacement, xp.shape, self.rng)

        def logG(self, t: int, xp: Any, x: np.ndarray) -> np.ndarray:  # noqa: N802
            return self.model.log_likelihood(x, self.strain)

    def __init__(self, model: PlainModel, scene: Scene, count: int) -> None:
        self._slide = self._Slide(model, scene)
        self._smc = particles.SMC(fk=self._slide, N=count, resampling="systematic", ESSrmin=1.0)
        next(self._smc)

    def spread(self) -> None:
        """Draw uniform particles, as after a measurement update."""
        self._smc.X = self._slide.M0(self._smc.N)

    def step(self, displacement: np.ndarray, strain: np.ndarray) -> None:
        """Resample, predict, weight."""
        self._slide.displacement, self._slide.strain = displacement, strain
        next(self._smc)


class Pfilter:
    """pfilter: functions for prior, motion and weight."""

    def __init__(self, model: PlainModel, scene: Scene, count: int) -> None:
        self._scene, self._rng = scene, np.random.default_rng(0)
        self._displacement = np.zeros(2)

        def weights(states: np.ndarray, strain: np.ndarray, **_: Any) -> np.ndarray:
            log_weights = model.log_likelihood(states, strain[0])
            return np.exp(log_weights - log_weights.max())

        self._filter = PFilter(
            prior_fn=lambda n: uniform(scene, n, self._rng),
            dynamics_fn=lambda states, **_: states + self._displacement,
            noise_fn=lambda states, **_: states + noise(scene, self._displacement, states.shape, self._rng),
            weight_fn=weights,
            resample_fn=pfilter_systematic,
            n_particles=count,
        )

    def spread(self) -> None:
        """Draw uniform particles."""
        self._filter.init_filter()

    def step(self, displacement: np.ndarray, strain: np.ndarray) -> None:
        """Predict, weight, resample; the package's update also computes moments."""
        self._displacement = displacement
        with np.errstate(divide="ignore", invalid="ignore"):
            self._filter.update(strain)


class Stonesoup:
    """Stone Soup: predictor, updater and resampler, with user-defined motion and measurement models."""

    class _Slide(TransitionModel):
        scene: Any = Property(doc="scene")
        displacement: Any = Property(doc="displacement of the next prediction, (2,) m")
        rng: Any = Property(doc="generator of the noise")

        ndim_state = 2

        def function(self, state: Any, **_: Any) -> StateVectors:
            states = np.asarray(state.state_vector, dtype=float).T
            moved = states + self.displacement + noise(self.scene, self.displacement, states.shape, self.rng)
            return StateVectors(moved.T)

        rvs = pdf = None  # not used by a particle filter whose motion model adds the noise

    class _Strain(MeasurementModel):
        model: Any = Property(doc="the plain model")

        ndim_meas = 16

        def logpdf(self, detection: Any, state: Any, **_: Any) -> np.ndarray:
            states = np.asarray(state.state_vector, dtype=float).T
            return self.model.log_likelihood(states, np.asarray(detection.state_vector, dtype=float).ravel())

        function = rvs = pdf = None  # not used by a particle filter

    def __init__(self, model: PlainModel, scene: Scene, count: int) -> None:
        self._scene, self._count, self._rng = scene, count, np.random.default_rng(0)
        self._slide = self._Slide(scene, np.zeros(2), self._rng)
        self._measurement_model = self._Strain(ndim_state=2, mapping=(0, 1), model=model)
        self._predictor = ParticlePredictor(self._slide)
        self._updater = ParticleUpdater(self._measurement_model, SystematicResampler())
        self._time = datetime.datetime(2020, 1, 1, tzinfo=datetime.timezone.utc)
        self.spread()

    def spread(self) -> None:
        """Draw uniform particles."""
        states = StateVectors(uniform(self._scene, self._count, self._rng).T)
        weights = np.full(self._count, -math.log(self._count))
        self._state = ParticleState(states, log_weight=weights, timestamp=self._time)

    def step(self, displacement: np.ndarray, strain: np.ndarray) -> None:
        """Predict, weight, resample."""
        self._time += datetime.timedelta(seconds=0.01)
        self._slide.displacement = displacement
        prediction = self._predictor.predict(self._state, timestamp=self._time)
        detection = Detection(
            strain[:, None], timestamp=self._time, measurement_model=self._measurement_model
        )
        self._state = self._updater.update(SingleHypothesis(prediction, detection))


def uniform(scene: Scene, count: int, rng: np.random.Generator) -> np.ndarray:
    """Uniform states over the scene, (count, 2)."""
    return scene.lower + rng.random((count, 2)) * scene.extent


def noise(
    scene: Scene, displacement: np.ndarray, shape: tuple[int, ...], rng: np.random.Generator
) -> np.ndarray:
    """Motion noise of a displacement, of shape ``shape``."""
    return rng.standard_normal(shape) * scene.motion_std * math.sqrt(float(np.hypot(*displacement)))


PEERS = {"particles": Particles, "filterpy": Filterpy, "stonesoup": Stonesoup, "pfilter": Pfilter}
