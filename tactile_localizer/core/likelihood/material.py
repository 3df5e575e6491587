"""Parameters of the model that depend on whether the material is a sheet, cloth or something in between."""

from __future__ import annotations

import math
from typing import NamedTuple

_SHEET, _CLOTH = 0.1, 0.3
"""Texture ratios up to which a material is a sheet, and from which it is cloth. By judgement."""
_SESSION_RATIO = 4.0
"""Variance ratio of sheets: another session differs twice as much. By judgement."""
_CLOTH_MEMORY = 0.01
"""m of travel over which the level is averaged on cloth. By judgement."""
_SHEET_LENGTH, _CLOTH_LENGTH = 0.0017, 0.006
"""Information lengths, m. By judgement."""


class Material(NamedTuple):
    """Parameters of the model that depend on the material.

    Parameters
    ----------
    has_level : whether the strain of featureless places defines the level of a sweep. If it does not, the
        noise of all phalanges is whitened jointly, because the ripple of the force is common to them
    session_ratio : variance of the level of a new sweep, in that of the scan's sweeps; infinite: unknown
    memory : m of travel over which the level is averaged; infinite for a constant
    information_length : m of travel per independent measurement of the position
    """

    has_level: bool
    session_ratio: float
    memory: float
    information_length: float

    @classmethod
    def of(cls, texture_ratio: float) -> Material:
        """Interpolate between a sheet and cloth.

        Parameters
        ----------
        texture_ratio : median of the signal's energy over all places, divided by its 0.9 quantile; nearly
            zero on a sheet with few features
        """
        sheet = min(max((_CLOTH - texture_ratio) / (_CLOTH - _SHEET), 0.0), 1.0)
        return cls(
            has_level=sheet > 0.5,
            session_ratio=_SESSION_RATIO / sheet if sheet > 0.0 else math.inf,
            memory=_CLOTH_MEMORY / (1.0 - sheet) if sheet < 1.0 else math.inf,
            information_length=sheet * _SHEET_LENGTH + (1.0 - sheet) * _CLOTH_LENGTH,
        )
