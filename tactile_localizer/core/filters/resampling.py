"""Resampling of particles in proportion to their weights.

The four schemes are described by Douc, Cappé and Moulines, "Comparison of resampling schemes for particle
filtering" (2005). Each maps weights (P,) that sum to one to the indices (count,) of the ancestors, and is
unbiased: the expected number of copies of particle i is ``count * weights[i]``.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tactile_localizer.errors import ParameterError

Resampler = Callable[[np.ndarray, int, np.random.Generator], np.ndarray]


def evenly(weights: np.ndarray, count: int) -> np.ndarray:
    """Deterministic systematic resampling, with a central offset: a representative sample."""
    return _invert(weights, (np.arange(count) + 0.5) / count)


def systematic(weights: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Evenly spaced points with one random offset: low variance at the lowest cost."""
    return _invert(weights, (np.arange(count) + rng.random()) / count)


def stratified(weights: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """One random point in each of ``count`` equal strata."""
    return _invert(weights, (np.arange(count) + rng.random(count)) / count)


def multinomial(weights: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Independent draws, with the highest variance."""
    return _invert(weights, np.sort(rng.random(count)))


def residual(weights: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """The integer part of ``count * weights`` deterministically, the rest by independent draws."""
    expected = np.asarray(weights, dtype=np.float64)
    expected = count * (expected / expected.sum())
    # The product of a weight and the count may be a rounding error below an integer.
    copies = np.floor(expected + 1e-12 * count).astype(np.intp)
    certain = np.repeat(np.arange(len(weights)), copies)[:count]
    missing = count - len(certain)
    if missing == 0:
        return certain
    rest = np.maximum(expected - copies, 0.0)
    return np.concatenate([certain, multinomial(rest / rest.sum(), missing, rng)])


RESAMPLERS: dict[str, Resampler] = {
    "systematic": systematic,
    "stratified": stratified,
    "multinomial": multinomial,
    "residual": residual,
}


def resampler(name: str) -> Resampler:
    """The scheme with this name; an unknown name is a :class:`.ParameterError`."""
    try:
        return RESAMPLERS[name]
    except KeyError:
        raise ParameterError(f"resampling {name!r}: expected one of {', '.join(RESAMPLERS)}") from None


def _invert(weights: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Indices of the particles at the ascending ``points`` in [0, 1) of the cumulative weights."""
    cumulative = np.cumsum(weights, dtype=np.float64)
    # Rounding must not put a point beyond the end, or on trailing particles of weight zero.
    total = cumulative[-1]
    last = int(np.searchsorted(cumulative, total, side="left"))
    return np.minimum(np.searchsorted(cumulative, points * total, side="right"), last)
