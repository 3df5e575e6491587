"""What depends on how evenly a material is felt: a sheet at its features alone, cloth everywhere."""

from __future__ import annotations

import math
from typing import NamedTuple

_SHEET, _CLOTH = 0.1, 0.3
"""Evenness up to which a material is a sheet, and from which it is cloth: at most 0.08 on 14 scans of
sheets, at least 0.36 on 12 of fabrics. By judgement."""


class Material(NamedTuple):
    """Values that a model takes from the kind of the material.

    Parameters
    ----------
    has_level : whether places without a signal show the level of a sweep, relative to which others have one;
        otherwise the noise of all phalanges is whitened together: the ripple of the force is common
    session_ratio : variance of the level of a new sweep, in that of the scan's sweeps; infinite: unknown
    memory : m of travel over which the level is averaged; infinite for a constant
    information_length : m of travel per independent measurement of the position
    """

    has_level: bool
    session_ratio: float
    memory: float
    information_length: float

    @classmethod
    def of(cls, evenness: float) -> Material:
        """From how even the signal is: energy at a typical place, in that at a strong one."""
        sheet = min(max((_CLOTH - evenness) / (_CLOTH - _SHEET), 0.0), 1.0)
        return cls(
            has_level=sheet > 0.5,
            # Another session differs twice as much; with a hundred times a feature was mistaken for a level.
            session_ratio=4.0 / sheet if sheet > 0.0 else math.inf,
            memory=0.01 / (1.0 - sheet) if sheet < 1.0 else math.inf,
            information_length=0.006 - 0.0043 * sheet,
        )
