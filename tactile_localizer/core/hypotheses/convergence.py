"""Whether the position has converged: a probability, held over a distance."""

from dataclasses import dataclass
from enum import Enum

import numpy as np

from tactile_localizer.core import compiled


class State(Enum):
    """Where a localization stands."""

    SEARCHING = "searching"
    """The position is open."""
    CONVERGED = "converged"
    """The position is right with a high probability."""
    LOST = "lost"
    """The position was right, and is probably not any more."""
    UNKNOWN = "unknown"
    """The map does not explain what is felt: other material, another force, or a hurt hand."""


@dataclass(frozen=True)
class ConvergenceCriteria:
    """Thresholds of :class:`Convergence`.

    Parameters
    ----------
    radius : (d,) m (yaw: rad) about the estimate within which the hand has to be
    probability : that it is on the map and there, above which the position has converged; that of other
        material, above which nothing on the map is searched for
    sustain : m of travel over which this must hold
    release : probability below which a converged position is lost: it is more probably wrong
    """

    radius: np.ndarray
    probability: float = 0.97
    sustain: float = 0.001
    release: float = 0.5


class Ellipsoid:
    """Ellipsoid about a state, and the normal distribution with which a belief is convolved.

    Parameters
    ----------
    radius : (d,) half-axes, m (yaw: rad)
    variance : (d,) of the normal distribution
    """

    def __init__(self, radius: np.ndarray, variance: np.ndarray) -> None:
        spread = np.maximum(variance / radius**2, 1e-9)
        order = np.array([[1], [2], [3]])
        powers = spread**order
        self._sums, self._factors = powers.sum(axis=1)[:, None], powers / spread * order
        self._radius = radius[:, None]
        self._reach = float((1.0 + 3.0 * np.sqrt(spread.max())) ** 2)

    def probability(self, away: np.ndarray, weights: np.ndarray) -> float:
        """Probability that the hand is within, for deviations (P, d) of states with ``weights`` (P,).

        By the approximation of Jensen and Solomon (1972) to the distribution of a quadratic form: within
        0.01, above 0.98 within 0.001.
        """
        if compiled.MODULE is not None:
            by_axis, each = (np.ascontiguousarray(one, dtype=np.float64) for one in (away.T, weights))
            given = self._radius, self._sums, self._factors, self._reach
            return float(compiled.MODULE.probability_within(by_axis, *given, each))
        squared = np.square(away.T / self._radius)
        near = (np.add.reduce(squared) <= self._reach).nonzero()[0]
        # Cumulants of the quadratic form.
        first, second, third = self._sums + self._factors @ squared.take(near, axis=1)
        power = 1.0 - first * third * (2.0 / 3.0) / np.square(second)
        scale = second / np.square(first)
        deviate = (first**-power - 1.0 - scale * power * (power - 1.0)) / (power * np.sqrt(2.0 * scale))
        deviate = np.minimum(np.maximum(deviate, -8.0), 8.0)
        # The normal distribution function, within 0.0002.
        inside = 1.0 / (1.0 + np.exp(-deviate * (1.5976 + 0.07056 * np.square(deviate))))
        return float(weights.take(near) @ inside)


class Convergence:
    """Decides from the probability that the hand is on the map and near the estimate.

    Attributes
    ----------
    criteria : may be changed at any time
    state, reason : as of the last update
    probability : that the position is right
    """

    def __init__(self, criteria: ConvergenceCriteria) -> None:
        self.criteria = criteria
        self.reset()

    @property
    def converged(self) -> bool:
        """Whether the position has converged."""
        return self.state is State.CONVERGED

    def reset(self) -> None:
        """Forget all updates."""
        self.state = State.SEARCHING
        self.reason = "not converged: no measurement yet"
        self.probability = 0.0
        self._held: float | None = None

    def update(
        self,
        near: float,
        on_map: float,
        unknown: float,
        travel: float,
        contradiction: str = "",
    ) -> None:
        """Take in one update of the filter.

        Parameters
        ----------
        near : mass of the belief within the radius of its mean
        on_map, unknown : probabilities of being on the map, and on unknown material
        travel : m since the last update
        contradiction : what is known to contradict the map, in words
        """
        criteria = self.criteria
        self.probability = near * on_map
        holds = self.probability > criteria.probability
        # The way to the first update that is above the threshold does not count.
        self._held = (0.0 if self._held is None else self._held + travel) if holds else None
        if contradiction:
            self.state, self._held = State.UNKNOWN, None
        elif self._held is not None and self._held >= criteria.sustain:
            self.state = State.CONVERGED
        elif self.state is State.CONVERGED:
            if self.probability < criteria.release:
                self.state = State.LOST
        elif self.state is not State.LOST or holds:
            self.state = State.UNKNOWN if unknown > criteria.probability else State.SEARCHING
        explained = self._explain(near, on_map, holds)
        self.reason = f"unknown material: {contradiction}" if contradiction else explained

    def _explain(self, near: float, on_map: float, holds: bool) -> str:
        if self.state is State.CONVERGED:
            kept = "" if holds else f", kept down to {self.criteria.release:g}"
            return f"converged: probability {self.probability:.3f}{kept}"
        if self._held is not None:
            held, needed = 1e3 * self._held, 1e3 * self.criteria.sustain
            return f"not converged: held over {held:.1f} of {needed:.1f} mm"
        prefix = {State.LOST: "lost", State.UNKNOWN: "unknown material"}.get(self.state, "not converged")
        if on_map < near:
            return f"{prefix}: the map explains what is felt with probability {on_map:.2f}"
        return f"{prefix}: the position is within the radius with probability {near:.2f}"
