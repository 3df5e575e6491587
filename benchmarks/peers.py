"""Speed of this package's particle filter against filterpy and particles, on the same model.

    make bench        # makes .venv-bench from requirements/bench.txt, measures speed.py, then this

The peers provide the filter; the model is what their user would write in numpy and scipy: strain distances
once for all particles, then position kernels. All run in one process and take turns, so that noise affects
all alike. A row is a filter and a number of particles: the median of an update that resamples, predicts and
weights particles all over the scene, us, and in times of this package's.
"""

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import math
import time
from typing import Any

import numpy as np
import particles
from filterpy.monte_carlo import systematic_resample
from paper_models import POSITION_STD, STRAIN_STD
from scipy.spatial.distance import cdist

from tactile_localizer.core.filters.particle import ParticleFilter
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.paper.sum_of_gaussians import SumOfGaussians
from tactile_localizer.scene import Scene

COUNTS = {75: 40, 1_000: 15, 10_000: 3}
"""Updates of each filter by number of particles."""
STEP = np.array([0.0005, 0.0])
"""Displacement between two updates, m."""

_ROWS = 1000
"""Particles whose kernels to all pairs are in memory at once."""


class PlainModel:
    """Straightforward implementation of the conditional sum of Gaussians.

    Parameters
    ----------
    scan : training pairs
    """

    def __init__(self, scan: Scan) -> None:
        self._positions, self._strain = scan.states / POSITION_STD, scan.strain / STRAIN_STD

    def log_likelihood(self, states: np.ndarray, strain: np.ndarray) -> np.ndarray:
        """Log-likelihood (P,) of a strain vector (16,) at states (P, 2), up to a constant."""
        squared = np.sum((self._strain - strain / STRAIN_STD) ** 2, axis=1)
        both = np.stack([np.exp(-0.5 * (squared - squared.min())), np.ones(len(squared))], axis=1)
        sums = np.concatenate(
            [
                np.exp(-0.5 * cdist(states[i : i + _ROWS] / POSITION_STD, self._positions, "sqeuclidean"))
                @ both
                for i in range(0, len(states), _ROWS)
            ]
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.nan_to_num(np.log(sums[:, 0]) - np.log(sums[:, 1]), nan=-np.inf)


class Own:
    """This package's particle filter and sum of Gaussians."""

    def __init__(self, scan: Scan, scene: Scene, count: int) -> None:
        self._model = SumOfGaussians(scan, scene, POSITION_STD, STRAIN_STD)
        self._filter = ParticleFilter(scene, np.random.default_rng(0), count, resample_below=1.0)

    def spread(self) -> None:
        """Draw uniform particles."""
        self._filter.reset()

    def step(self, strain: np.ndarray) -> None:
        """Predict, weight, resample."""
        predicted = self._filter.predict(STEP, float(STEP[0]))
        self._filter.update(self._model.log_likelihood(predicted.states, strain))


class Filterpy:
    """filterpy: its resampling in the loop of its book."""

    def __init__(self, scan: Scan, scene: Scene, count: int) -> None:
        self._model, self._scene, self._count = PlainModel(scan), scene, count
        self._rng = np.random.default_rng(0)

    def spread(self) -> None:
        """Draw uniform particles."""
        self._states = uniform(self._scene, self._count, self._rng)

    def step(self, strain: np.ndarray) -> None:
        """Predict, weight, resample."""
        self._states = moved(self._scene, self._states, self._rng)
        log_weights = self._model.log_likelihood(self._states, strain)
        weights = np.exp(log_weights - log_weights.max())
        self._states = self._states[systematic_resample(weights / weights.sum())]


class Particles:
    """particles: a Feynman-Kac model, run step by step by its SMC."""

    class _Slide(particles.FeynmanKac):
        def __init__(self, model: PlainModel, scene: Scene) -> None:
            super().__init__(T=10**9)
            self.model, self.scene = model, scene
            self.rng = np.random.default_rng(0)
            self.strain = np.zeros(16)

        def M0(self, N: int) -> np.ndarray:  # noqa: N802
            return uniform(self.scene, N, self.rng)

        def M(self, t: int, xp: np.ndarray) -> np.ndarray:  # noqa: N802
            return moved(self.scene, xp, self.rng)

        def logG(self, t: int, xp: Any, x: np.ndarray) -> np.ndarray:  # noqa: N802
            return self.model.log_likelihood(x, self.strain)

    def __init__(self, scan: Scan, scene: Scene, count: int) -> None:
        self._slide = self._Slide(PlainModel(scan), scene)
        self._smc = particles.SMC(fk=self._slide, N=count, resampling="systematic", ESSrmin=1.0)
        next(self._smc)

    def spread(self) -> None:
        """Draw uniform particles, as after a measurement update."""
        self._smc.X = self._slide.M0(self._smc.N)

    def step(self, strain: np.ndarray) -> None:
        """Resample, predict, weight."""
        self._slide.strain = strain
        next(self._smc)


def uniform(scene: Scene, count: int, rng: np.random.Generator) -> np.ndarray:
    """Uniform states over the scene, (count, 2)."""
    return scene.lower + rng.random((count, 2)) * scene.extent


def moved(scene: Scene, states: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """States after a step, with motion noise."""
    return states + STEP + rng.standard_normal(states.shape) * scene.motion_std * math.sqrt(STEP[0])


def compare(scan: Scan, scene: Scene, strains: np.ndarray) -> list[dict[str, Any]]:
    """A row for each filter and number of particles."""
    rows = []
    for count, updates in COUNTS.items():
        filters = {kind.__name__: kind(scan, scene, count) for kind in (Own, Filterpy, Particles)}
        times: dict[str, list[float]] = {name: [] for name in filters}
        for number in range(updates + 1):
            for name, one in filters.items():
                one.spread()
                began = time.perf_counter()
                one.step(strains[number % len(strains)])
                times[name].append(time.perf_counter() - began)
        median = {name: 1e6 * float(np.median(taken[1:])) for name, taken in times.items()}
        rows += [
            {"name": f"{count} particles, {name}", "value": taken, "ratio": taken / median["Own"]}
            for name, taken in median.items()
        ]
    return rows


if __name__ == "__main__":
    from rows import print_rows

    from tactile_localizer.sim import shipped_scene, simulate_scan

    scan = simulate_scan("bump", 1)
    measured = compare(scan, shipped_scene("bump"), scan.strain[:: len(scan) // 50])
    print_rows(("name",), {"value": ("us", ".0f"), "ratio": ("times own", ".1f")}, measured)
