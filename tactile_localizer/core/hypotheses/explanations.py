"""Hidden Markov model over the explanations of what is felt."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tactile_localizer.core.likelihood.other_material import PATCH_LENGTH
from tactile_localizer.core.weights import bayes

RELOCATION_RATE = 0.3
"""Rate at which a hand is placed anywhere on the map, from on it or from elsewhere, per metre of travel. By
judgement."""
RELOCATION_DISTANCE = 0.01
"""Distance from the estimate of places to which a hand is relocated, and least travel over which they must
explain the strain better, m. By judgement."""


class Explanations(NamedTuple):
    """Probabilities of the explanations of what is felt, with a sum of one.

    Parameters
    ----------
    tracked : the hand is on the map, where the filter follows it
    relocated : it was placed elsewhere on the map
    other : it is on other material, featureless or not
    anchor_weights : (R,) of the anchors, with a sum of one, given that the hand was relocated
    placed : (R,) fraction of the weight of each anchor that was placed there with the last motion
    """

    tracked: float
    relocated: float
    other: float
    anchor_weights: np.ndarray
    placed: np.ndarray = np.zeros(0)

    @classmethod
    def start(cls, anchors: int) -> Explanations:
        """Before the first strain: on the map as probable as not."""
        return cls(0.5, 0.0, 0.5, np.full(anchors, 1.0 / anchors))

    @property
    def on_map(self) -> float:
        """Probability that the map explains what is felt."""
        return self.tracked + self.relocated

    @property
    def injected(self) -> float:
        """Fraction of the filter's belief to be replaced by that of a relocated hand, which may be anywhere.

        Anchors are too few to tell where: of many places that feel alike, their spacing would choose one. It
        moves the mean, so it is zero while the hand is more probably where it was tracked.
        """
        return self.relocated / self.on_map if self.relocated > self.tracked else 0.0

    def predict(self, travel: float, left: float, lost: np.ndarray) -> Explanations:
        """After ``travel`` metres.

        Beyond the bounds moved the fraction ``left`` of the belief, and the anchors ``lost`` (R,) bool. Where
        :attr:`injected` is not zero, the filter has taken in the belief of a relocated hand.
        """
        tracked, relocated, other, weights = self[:4]
        if self.injected:
            tracked, relocated = tracked + relocated, 0.0
        if np.count_nonzero(lost):
            weights = np.where(lost, 0.0, weights)
            kept = float(weights.sum())
            relocated, other = relocated * kept, other + relocated * (1.0 - kept)
            weights = weights / kept if kept > 0.0 else np.full(len(weights), 1.0 / len(weights))
        # Other material is as probable as the map before the first strain, so either is left at one rate.
        stayed = math.exp(-travel / PATCH_LENGTH)
        returned = (1.0 - stayed) * other
        on_map = (1.0 - left) * stayed * tracked, stayed * relocated
        other = stayed * other + (tracked - on_map[0]) + (relocated - on_map[1])
        tracked, relocated = on_map[0] + returned, on_map[1]
        moved = -math.expm1(-RELOCATION_RATE * travel)
        arriving = moved * (tracked + other)
        anywhere, placed = relocated + arriving, np.zeros(len(weights))
        if arriving > 0.0:
            new = arriving / anywhere / len(weights)
            weights = relocated / anywhere * weights + new
            placed = new / weights
        return Explanations(tracked * (1.0 - moved), anywhere, other * (1.0 - moved), weights, placed)

    def update(self, travel: float, at_anchors: np.ndarray, other: float) -> Explanations:
        """Take in log-likelihoods of a strain, relative to that of the filter's belief and tempered.

        Parameters
        ----------
        travel : m since the last update
        at_anchors : (R,); ``-inf``: so near the estimate that the hand is tracked
        other : of other material
        """
        weights, relocated = bayes(self.anchor_weights, at_anchors)
        # What a finger brushes over a few millimetres is no reason to give up what explains it so far.
        against = -math.log(RELOCATION_RATE * RELOCATION_DISTANCE)
        relocated = min(relocated, max(other, 0.0) + against * travel / RELOCATION_DISTANCE)
        # Of three numbers, a loop is several times faster than arrays.
        given = zip(self[:3], (0.0, relocated, other), strict=True)
        logs = [log + math.log(prior) if prior else -math.inf for prior, log in given]
        if (peak := max(logs)) == -math.inf:
            return self._replace(anchor_weights=weights)
        joint = [math.exp(log - peak) for log in logs]
        tracked, relocated, other = (each / sum(joint) for each in joint)
        return Explanations(tracked, relocated, other, weights)
