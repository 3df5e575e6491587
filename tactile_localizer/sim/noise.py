"""Stationary random processes with unit variance, and independent generators from one seed."""

import numpy as np
from scipy.linalg import solve_banded


def child(seed: int, *path: int) -> np.random.Generator:
    """Random generator for ``path`` below ``seed``, independent of the other generators of that seed."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=path))


def recursion(values: np.ndarray, keep: float) -> np.ndarray:
    """First-order recursion y[n] = x[n] + keep * y[n - 1] along the first axis of ``values`` (n, columns).

    As ``scipy.signal.lfilter``, whose import takes most of the time in which the simulator starts.
    """
    bands = np.array([np.ones(len(values)), np.full(len(values), -keep)])
    return np.asarray(solve_banded((1, 0), bands, values))


def rough(rng: np.random.Generator, n: int, columns: int, correlation: float) -> np.ndarray:
    """Gauss-Markov noise (n, columns); its autocorrelation falls to 1/e after ``correlation`` samples."""
    keep = np.exp(-1 / correlation)
    innovations = rng.standard_normal((n, columns))
    innovations[1:] *= np.sqrt(1 - keep**2)
    return recursion(innovations, keep)


def smooth(rng: np.random.Generator, n: int, columns: int, correlation: float) -> np.ndarray:
    """Smooth noise (n, columns), correlated over about ``correlation`` samples.

    A Gauss-Markov process, low-pass filtered with its own time constant; the transient is discarded.
    """
    keep = np.exp(-2 / correlation)
    transient = int(4 * correlation)
    filtered = recursion((1 - keep) * rough(rng, n + transient, columns, correlation / 2), keep)
    return np.asarray(filtered[transient:] * np.sqrt((1 + keep) ** 2 / (1 + keep**2)))
