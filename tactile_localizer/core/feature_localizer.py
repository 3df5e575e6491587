"""Several scans as one localizer: what is believed is what the most probable of their features says."""

from __future__ import annotations

import numpy as np

from tactile_localizer.core.convergence import ConvergenceCriteria
from tactile_localizer.core.identification import NONE, FeatureIdentifier, Identification
from tactile_localizer.core.localizer import Estimate
from tactile_localizer.scene import Scene


class FeatureLocalizer:
    """Has what a :class:`~tactile_localizer.core.localizer.Localizer` has, over several candidates.

    Parameters
    ----------
    identifier : runs the candidates

    Attributes
    ----------
    identification : the last one; ``None`` before the first strain
    """

    def __init__(self, identifier: FeatureIdentifier) -> None:
        self._identifier = identifier
        self._believed = next(iter(identifier.localizers))
        self.identification: Identification | None = None

    @property
    def scene(self) -> Scene:
        """Of the candidate that is believed."""
        return self._identifier.localizers[self._believed].scene

    def reset(self) -> None:
        """Believe in every candidate and every state alike."""
        self._identifier.reset()
        self.identification = None

    def seed(self, mean: np.ndarray, std: np.ndarray) -> None:
        """On every candidate, believe in a Gaussian about ``mean`` (d,) with deviations ``std`` (d,)."""
        self._identifier.reset()
        for localizer in self._identifier.localizers.values():
            localizer.seed(mean, std)
        self.identification = None

    def adjust(self, criteria: ConvergenceCriteria, update_distance: float) -> None:
        """As :meth:`.Localizer.adjust`, of every candidate."""
        for localizer in self._identifier.localizers.values():
            localizer.adjust(criteria, update_distance)

    def hypotheses(self) -> tuple[np.ndarray, np.ndarray]:
        """States (P, d) and weights (P,) of the candidate that is believed."""
        return self._identifier.localizers[self._believed].hypotheses()

    def update(
        self, stamp_ns: int, position: np.ndarray, strain: np.ndarray, present: np.ndarray | None = None
    ) -> Estimate:
        """As :meth:`.Localizer.update`; on none of the features no position is to be believed."""
        self.identification = self._identifier.update(stamp_ns, position, strain, present)
        most_probable = self.identification.most_probable
        if most_probable == NONE:
            estimate = self.identification.estimates[self._believed]
            return estimate._replace(converged=False, reason="not converged: none of the features")
        self._believed = most_probable
        return self.identification.estimates[most_probable]
