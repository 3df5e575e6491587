"""Positions of the phalanges on the material.

``T_material_phalanx = T_material_palm @ T_palm_phalanx``, where ``T_material_palm`` is the palm's state
(x, y, yaw) and ``T_palm_phalanx`` the phalanx's offset in the palm's frame: the offset turns with the palm.
An axis that the scene does not name is zero.
"""

import numpy as np

from tactile_localizer.core.geometry.angles import wrap_angle
from tactile_localizer.scene import Phalanx, Scene


def phalanx_positions(scene: Scene, phalanx: Phalanx, states: np.ndarray) -> np.ndarray:
    """Positions (P, d), m (yaw: rad), of a phalanx at palm ``states`` (P, d); full-turn axes in [-pi, pi)."""
    positions = states + turned_offsets(scene, phalanx, states)
    for axis in np.flatnonzero(scene.wraps):
        positions[:, axis] = wrap_angle(positions[:, axis])
    return positions


def turned_offsets(scene: Scene, phalanx: Phalanx, states: np.ndarray) -> np.ndarray:
    """Offsets (P, d), m (yaw: rad), of a phalanx from the palm at ``states`` (P, d), on the scene's axes."""
    names = scene.axis_names
    offsets = np.tile(np.asarray(phalanx.offset, dtype=np.float64), (len(states), 1))
    if "yaw" not in names:
        return offsets
    yaw = states[:, names.index("yaw")]
    given = dict(zip(names, phalanx.offset, strict=True))
    x, y = given.get("x", 0.0), given.get("y", 0.0)
    turned = {"x": x * np.cos(yaw) - y * np.sin(yaw), "y": x * np.sin(yaw) + y * np.cos(yaw)}
    for column, name in enumerate(names):
        if name in turned:
            offsets[:, column] = turned[name]
    return offsets


def phalanges_on_feature(scene: Scene, states: np.ndarray) -> np.ndarray:
    """Whether each phalanx is in the feature's region at ``states`` (P, d): (P, F); all without a region."""
    on = np.ones((len(states), len(scene.phalanges)), dtype=bool)
    if scene.feature is not None:
        for index, phalanx in enumerate(scene.phalanges):
            on[:, index] = scene.feature.contains(phalanx_positions(scene, phalanx, states))
    return on
