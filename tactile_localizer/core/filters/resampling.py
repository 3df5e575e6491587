"""Resampling: which particles survive, drawn in proportion to their weights.

Douc, Cappé and Moulines, "Comparison of resampling schemes for particle filtering" (2005), describe
the four schemes. Each maps weights (P,) that sum to one to the indices (count,) of the ancestors,
and is unbiased: particle i is expected ``count * weights[i]`` times.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tactile_localizer.errors import ParameterError

Resampler = Callable[[np.ndarray, int, np.random.Generator], np.ndarray]


def evenly(weights: np.ndarray, count: int) -> np.ndarray:
    """Systematic with the offset in the middle: indices of what stands for the whole, the same each time."""
    return _invert(weights, (np.arange(count) + 0.5) / count)


def systematic(weights: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """One random offset, then evenly spaced: the least variance for the least work."""
    return _invert(weights, (np.arange(count) + rng.random()) / count)


def stratified(weights: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """One random point in each of ``count`` equal strata."""
    return _invert(weights, (np.arange(count) + rng.random(count)) / count)


def multinomial(weights: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Independent draws: the textbook scheme, and the noisiest."""
    return _invert(weights, np.sort(rng.random(count)))


def residual(weights: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """The whole part of ``count * weights`` for certain, the rest by independent draws."""
    expected = np.asarray(weights, dtype=np.float64)
    expected = count * (expected / expected.sum())
    # A weight such as 1/3 times 3 may fall a rounding error short of a whole copy.
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
    """The scheme called ``name``.

    Raises
    ------
    ParameterError
        No scheme has that name.
    """
    try:
        return RESAMPLERS[name]
    except KeyError:
        raise ParameterError(f"resampling {name!r}: expected one of {', '.join(RESAMPLERS)}") from None


def _invert(weights: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Indices of the particles that the ascending ``points`` in [0, 1) fall on."""
    cumulative = np.cumsum(weights, dtype=np.float64)
    # Dividing by the last entry, not by one: rounding must not leave a point beyond the end, and a
    # point that rounds up to the total must not fall on trailing particles of weight zero.
    total = cumulative[-1]
    last = int(np.searchsorted(cumulative, total, side="left"))
    return np.minimum(np.searchsorted(cumulative, points * total, side="right"), last)
