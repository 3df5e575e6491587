"""Parameters of the model that depend on whether the material is a sheet, cloth or something in between."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tactile_localizer.core.likelihood.drift import innovations

_SHEET, _CLOTH = 0.1, 0.3
"""Texture ratios up to which a material is a sheet, and from which it is cloth. By judgement."""
_WANDERS = 10.0
"""Evidence from which a level is taken to wander, nats; with less, the more there is the less of a sheet it
is. By judgement: on ten scans of sheets it is negative, on two of taxels 7 and 38, on fabrics and a
BioTac 9 to 200."""
_SESSION_RATIO = 4.0
"""Variance ratio of sheets: another session, with another force, differs twice as much. By judgement."""
CLOTH_MEMORY = 0.01
"""m of travel over which the level is averaged on cloth, and the energy of a texture. By judgement."""


class Material(NamedTuple):
    """Parameters of the model that depend on the material.

    Parameters
    ----------
    sheet : from 0, the level of a sweep wanders, as on cloth under a finger, to 1, it is constant and defined
        by the strain of featureless places, as on a sheet with features
    """

    sheet: float

    @classmethod
    def of(cls, texture_ratio: float, wander: float) -> Material:
        """The material of a scan, whose level is known as far as there are featureless places and it keeps.

        Parameters
        ----------
        texture_ratio : median of the signal's energy over all places, divided by its 0.9 quantile; nearly
            zero on a sheet with few features
        wander : log-likelihood of the scan's residuals if the level of a sweep wanders, less that if it is
            constant, nats
        """
        featureless, kept = (_CLOTH - texture_ratio) / (_CLOTH - _SHEET), 1.0 - wander / _WANDERS
        return cls(min(max(min(featureless, kept), 0.0), 1.0))

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
        return CLOTH_MEMORY / (1.0 - self.sheet) if self.sheet < 1.0 else math.inf

    def mixed(self, sheet: np.ndarray, cloth: np.ndarray | float) -> np.ndarray:
        """A value in between one for a sheet and one for cloth."""
        return self.sheet * sheet + (1.0 - self.sheet) * cloth

    def innovations(self, values: np.ndarray, pitch: float, robust: bool = False) -> np.ndarray:
        """What of values (n, C) at every ``pitch`` metres of a scan's sweep is not its level."""
        return innovations(values, self.memory, self.level_variance, pitch, robust)
