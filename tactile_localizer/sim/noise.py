"""Random processes of the simulation, stationary and of unit variance, and the seeds they grow from."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter


def child(seed: int, *path: int) -> np.random.Generator:
    """The generator at ``path`` below ``seed``: the same whatever else is drawn from that seed."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=path))


def rough(rng: np.random.Generator, n: int, columns: int, correlation: float) -> np.ndarray:
    """Gauss-Markov noise (n, columns) whose correlation falls by e in ``correlation`` samples."""
    keep = np.exp(-1 / correlation)
    innovations = rng.standard_normal((n, columns))
    innovations[1:] *= np.sqrt(1 - keep**2)
    return np.asarray(lfilter([1.0], [1.0, -keep], innovations, axis=0))


def smooth(rng: np.random.Generator, n: int, columns: int, correlation: float) -> np.ndarray:
    """Noise (n, columns) with a smooth course, correlated over about ``correlation`` samples.

    A Gauss-Markov process filtered once more by its own time constant; the run-in is cut off.
    """
    keep = np.exp(-2 / correlation)
    run_in = int(4 * correlation)
    course = lfilter([1 - keep], [1.0, -keep], rough(rng, n + run_in, columns, correlation / 2), axis=0)
    return np.asarray(course[run_in:] * np.sqrt((1 + keep) ** 2 / (1 + keep**2)))
