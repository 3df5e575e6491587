"""A simulated hand that sweeps over the bump at several angles, and its scene with yaw."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache

import numpy as np

from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.resources import resource_path
from tactile_localizer.scene import Axis, Phalanx, Region, Scene
from tactile_localizer.sim import simulate_scan

_BUMP = load_scene(resource_path("config/scenes/bump.yaml"))
assert _BUMP.feature is not None
SCENE = Scene(
    "turned bump",
    (*_BUMP.axes, Axis("yaw", -0.2, 0.2, 0.05)),
    tuple(Phalanx(phalanx.name, (*phalanx.offset, 0.0)) for phalanx in _BUMP.phalanges),
    Region((*_BUMP.feature.lower, -math.inf), (*_BUMP.feature.upper, math.inf)),
)


@cache
def turned_scan(yaws: Sequence[float], seeds: Sequence[int] = (1,)) -> Scan:
    """Training sweeps at each of some yaws (rad), one session after another, with true positions."""
    sessions = [simulate_scan("bump", seed, yaw=yaw) for seed, yaw in zip(seeds, yaws, strict=True)]
    states = [np.column_stack([s.truth, np.full(len(s), yaw)]) for s, yaw in zip(sessions, yaws, strict=True)]
    return Scan(
        np.concatenate(states),
        np.concatenate([session.strain for session in sessions]),
        np.concatenate([session.sweep + 100 * number for number, session in enumerate(sessions)]),
        ("x", "y", "yaw"),
        SCENE.phalanx_names,
    )
