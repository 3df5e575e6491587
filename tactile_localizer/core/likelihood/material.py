"""What differs between material with featureless places and material that is felt everywhere."""

from __future__ import annotations

import math
from typing import NamedTuple

from tactile_localizer.core.scan.interpolation import PAIRS


class Material(NamedTuple):
    """Values that a model takes from the kind of the material.

    Parameters
    ----------
    has_level : whether places without a signal show the level of a sweep, relative to which others have one
    joint_noise : whether the noise of all phalanges is whitened together: the ripple of the force is common
    session_ratio : variance of the level of a new sweep, in that of the scan's sweeps; infinite: unknown
    memory : m of travel over which the level is averaged; infinite for a constant
    information_length : m of travel per independent measurement of the position
    components : pairs of sweeps from which a place is interpolated
    anchors : number of trajectories, about, that represent the whole map
    """

    has_level: bool
    joint_noise: bool
    session_ratio: float
    memory: float
    information_length: float
    components: int
    anchors: int


# The variance of a new level counts four times, because another session differs twice as much; with a hundred
# times the feature was mistaken for a level. Boxes of anchors are 3.5 and 1.3 mm wide in a square of 50 mm.
SHEET = Material(True, False, 4.0, math.inf, 0.0017, PAIRS, 200)
CLOTH = Material(False, True, math.inf, 0.01, 0.005, 1, 1600)
