"""What the model assumes of the level of a sweep: that of a sheet, or of cloth."""

import math
from enum import Enum

import numpy as np

from tactile_localizer.core.likelihood.drift import innovations

_SESSION_RATIO = 4.0
"""Variance ratio of sheets: another session, with another force, differs twice as much. By judgement."""
CLOTH_MEMORY = 0.01
"""m of travel over which the level is averaged on cloth. By judgement."""


class Material(Enum):
    """Kind of a material, by what the level of a sweep is. The examination chooses it."""

    SHEET = "sheet"
    """The level is constant, and defined by the strain of featureless places."""
    CLOTH = "cloth"
    """The level wanders, as under a finger on cloth, and nothing defines it."""

    @property
    def session_ratio(self) -> float:
        """Variance of the level of a new sweep, in that of the scan's sweeps; infinite: unknown."""
        return _SESSION_RATIO if self is Material.SHEET else math.inf

    @property
    def memory(self) -> float:
        """Travel over which the level is averaged, m; infinite for a constant."""
        return math.inf if self is Material.SHEET else CLOTH_MEMORY

    def innovations(self, values: np.ndarray, pitch: float, robust: bool = False) -> np.ndarray:
        """What of values (n, C) at every ``pitch`` metres of a scan's sweep is not its level."""
        return values if self is Material.SHEET else innovations(values, self.memory, pitch, robust)
