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

YAWS = (-0.2, 0.0, 0.2)
_BUMP = load_scene(resource_path("config/scenes/bump.yaml"))
assert _BUMP.feature is not None
REGION = Region((*_BUMP.feature.lower, -math.inf), (*_BUMP.feature.upper, math.inf))
SCENE = Scene(
    "turned bump",
    (*_BUMP.axes, Axis("yaw", -0.2, 0.2, 0.05)),
    tuple(Phalanx(phalanx.name, (*phalanx.offset, 0.0)) for phalanx in _BUMP.phalanges),
    REGION,
)


@cache
def turned_scan(yaws: Sequence[float], seeds: Sequence[int] | None = None) -> Scan:
    """Training sweeps at each of some yaws (rad), one session after another, with true positions.

    Without a seed for each, all sessions have the same noise and deformations.
    """
    seeds = seeds or [1] * len(yaws)
    sessions = [simulate_scan("bump", seed, yaw=yaw) for seed, yaw in zip(seeds, yaws, strict=True)]
    states = [np.column_stack([s.truth, np.full(len(s), yaw)]) for s, yaw in zip(sessions, yaws, strict=True)]
    return Scan(
        np.concatenate(states),
        np.concatenate([session.strain for session in sessions]),
        np.concatenate([session.sweep + 100 * number for number, session in enumerate(sessions)]),
        ("x", "y", "yaw"),
        SCENE.phalanx_names,
    )


def bump_strength(scan: Scan, phalanx: int) -> np.ndarray:
    """Distance of the strain of a phalanx from that of featureless material, (N,) V."""
    own = scan.layout.slices[phalanx]
    return np.asarray(np.linalg.norm(scan.strain[:, own] - np.median(scan.strain[:, own], axis=0), axis=1))
