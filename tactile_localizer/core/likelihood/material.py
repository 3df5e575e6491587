"""Parameters of the model that depend on whether the material is a sheet, cloth or something in between."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.special import expit

from tactile_localizer.core.likelihood.drift import innovations

_EVIDENCE = 5.0
"""Evidence from which a level is rather taken to wander, nats: "very strong" to Kass and Raftery (1995)."""
_SESSION_RATIO = 4.0
"""Variance ratio of sheets: another session, with another force, differs twice as much. By judgement."""
_CLOTH_MEMORY = 0.01
"""m of travel over which the level is averaged on cloth. By judgement."""


class Material(NamedTuple):
    """Parameters of the model that depend on the material.

    Parameters
    ----------
    sheet : from 0, cloth that is felt everywhere, to 1, a sheet that is featureless between features. So far
        the strain of featureless places defines the level of a sweep
    """

    sheet: float

    @classmethod
    def of(cls, wander: float) -> Material:
        """The material of a scan.

        Parameters
        ----------
        wander : log-likelihood of the scan's residuals if the level of a sweep wanders, less that if it is constant,
            nats
        """
        return cls(round(float(expit(_EVIDENCE - wander)), 6))

    @property
    def session_ratio(self) -> float:
        """Variance of the level of a new sweep, in that of the scan's sweeps; infinite: unknown."""
        return _SESSION_RATIO / self.sheet if self.sheet > 0.0 else math.inf

    @property
    def level_variance(self) -> float:
        """Variance of what is left of the level of a scan's sweep, in that of a strain."""
        return (1.0 - self.sheet) / self.sheet if self.sheet > 0.0 else math.inf

    @property
    def memory(self) -> float:
        """Travel over which the level is averaged, m; infinite for a constant."""
        return _CLOTH_MEMORY / (1.0 - self.sheet) if self.sheet < 1.0 else math.inf

    def mixed(self, sheet: np.ndarray, cloth: np.ndarray | float) -> np.ndarray:
        """A value in between one for a sheet and one for cloth."""
        return self.sheet * sheet + (1.0 - self.sheet) * cloth

    def innovations(self, values: np.ndarray, pitch: float, robust: bool = False) -> np.ndarray:
        """What of values (n, C) at every ``pitch`` metres of a scan's sweep is not its level."""
        return innovations(values, self.memory, self.level_variance, pitch, robust)
