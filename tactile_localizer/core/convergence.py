"""When the position may be believed: a narrow belief *and* evidence, both sustained over travelled distance.

The paper (III-D) found that a narrow belief alone, or a high likelihood alone, signals convergence before the
hand touches anything: a measurement unlike everything still prefers something. Evidence compares how well the
believed place explains the strain with the best position-blind explanation (:class:`~.null_model.NullModel`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tactile_localizer.core.filters.belief import Belief


@dataclass(frozen=True)
class ConvergenceCriteria:
    """Thresholds of :class:`Convergence`.

    Parameters
    ----------
    std : (d,) m (yaw: rad); the belief is narrow when the mean of its variances over ``std**2`` is at most
    one
    evidence : nats that the place must have gathered over the position-blind explanation
    sustain : m of travel over which both must hold
    """

    std: np.ndarray
    evidence: float = 4.0
    sustain: float = 0.0005


class Convergence:
    """Gathers evidence along the travel and decides, with the reason.

    The evidence rises while the believed place explains what is felt better than featureless or unknown
    material, stays where both do equally well (past the feature, where the motion alone carries the
    position), and falls where the believed place is contradicted. It is kept between zero and three times the
    threshold, so that old evidence cannot outvote a contradiction for long.

    Until a position is believed, an allowance is taken off every log-ratio, as in the cumulative sum test of
    Page (1954). The belief may explain a strain by the map or as featureless, whichever is better; the larger
    of two densities integrates to at most two, so that without an allowance of log 2 chance alone could
    gather evidence on material where there is nothing to feel.

    Attributes
    ----------
    criteria : may be changed at any time; what was gathered stays
    """

    _MEASURE = 0.004
    """m of travel over which a log-ratio of one nat makes evidence of one nat."""
    _ALLOWANCE = math.log(2.0)
    _MOST = 3.0
    _LARGEST_STEP = 20.0
    _RELEASE = 4.0
    """Converged is kept until the variances are this many times the threshold, or the evidence is gone."""

    def __init__(self, criteria: ConvergenceCriteria) -> None:
        self.criteria = criteria
        self.reset()

    def reset(self) -> None:
        """Forget all evidence."""
        self.evidence = 0.0
        self.converged = False
        self.reason = "not converged: nothing felt yet"
        self._held = 0.0

    def update(self, belief: Belief, log_ratio: float, travel: float) -> None:
        """Take in one update of the filter.

        Parameters
        ----------
        belief : after the update
        log_ratio : log-likelihood of the strain by the belief, less that by the null, nats
        travel : m that the strain speaks for
        """
        criteria = self.criteria
        step = min(max(log_ratio, -self._LARGEST_STEP), self._LARGEST_STEP)
        if not self.converged:
            step -= self._ALLOWANCE
        most = self._MOST * criteria.evidence
        self.evidence = min(max(self.evidence + travel / self._MEASURE * step, 0.0), most)
        spread = float((belief.covariance.diagonal() / criteria.std**2).mean())
        if self.converged:
            self._check_release(spread)
            return
        holds = spread <= 1.0 and self.evidence >= criteria.evidence
        self._held = self._held + travel if holds else 0.0
        self.converged = holds and self._held >= criteria.sustain
        self.reason = self._explain(spread, holds)

    def _check_release(self, spread: float) -> None:
        if self.evidence <= 0.0:
            self.converged, self.reason = False, "lost: the evidence for the believed place is gone"
        elif spread > self._RELEASE:
            self.converged, self.reason = False, f"lost: variances {spread:.1f} times the threshold"
        self._held = 0.0

    def _explain(self, spread: float, holds: bool) -> str:
        needed = self.criteria.evidence
        if self.converged:
            return f"converged: variances {spread:.2f} of the threshold, evidence {self.evidence:.1f} nats"
        if holds:
            return f"not converged: held for {self._held * 1e3:.1f} of {self.criteria.sustain * 1e3:.1f} mm"
        if self.evidence < needed:
            return f"not converged: evidence {self.evidence:.1f} of {needed:.1f} nats"
        return f"not converged: variances {spread:.1f} times the threshold"
