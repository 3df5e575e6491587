"""What differs between material with featureless places and material that is felt everywhere."""

from __future__ import annotations

import math
from typing import NamedTuple


class Material(NamedTuple):
    """Values that a model takes from the kind of the material.

    Parameters
    ----------
    has_level : whether places without a signal show the level of a sweep, relative to which others have one
    joint_noise : whether the noise of all phalanges is whitened together: the ripple of the force is common
    session_ratio : variance of the level of a new sweep, in that of the scan's sweeps; infinite: unknown
    memory : m of travel over which the level is averaged; infinite for a constant
    information_length : m of travel per independent measurement of the position
    """

    has_level: bool
    joint_noise: bool
    session_ratio: float
    memory: float
    information_length: float


# The variance of a new level counts four times, because another session differs twice as much; with a hundred
# times the feature was mistaken for a level.
SHEET = Material(True, False, 4.0, math.inf, 0.0017)
CLOTH = Material(False, True, math.inf, 0.01, 0.006)
