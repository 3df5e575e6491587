"""Odometry for recordings of the palm's true positions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tactile_localizer.core.geometry.angles import wrap_angle
from tactile_localizer.core.geometry.motion import levers
from tactile_localizer.io.recording import Recording
from tactile_localizer.scene import Scene

SIMULATED, EXACT, RECORDED = "simulated", "exact", "recorded"
"""Kinds of odometry: true displacements with or without the scene's motion noise, or the arm's."""


def with_odometry(recording: Recording, scene: Scene, rng: np.random.Generator, kind: str) -> Recording:
    """Make the positions of a recording its truth, and odometry its positions.

    Parameters
    ----------
    recording : recording of true positions
    scene : gives the motion noise: variance ``motion_std**2`` per metre of travel on each axis
    rng : generator of the noise
    kind : :data:`SIMULATED` or :data:`EXACT`

    Returns
    -------
    Recording
        The odometry of each sweep starts at zero, so it does not reveal the position of the palm.
    """
    sweeps = []
    for sweep in recording.sweeps:
        steps = displacements(scene, sweep.position)
        if kind == SIMULATED:
            spread = np.sqrt(travel(scene, steps))[:, None] * scene.motion_std
            steps = steps + rng.standard_normal(steps.shape) * spread
        odometry = np.vstack([np.zeros((1, scene.dimension)), np.cumsum(steps, axis=0)])[: len(sweep)]
        sweeps.append(replace(sweep, position=odometry, truth=sweep.position))
    return replace(recording, sweeps=tuple(sweeps))


def displacements(scene: Scene, position: np.ndarray) -> np.ndarray:
    """Differences (n - 1, d) between consecutive positions (n, d); yaw along the shortest arc."""
    steps = np.diff(position, axis=0)
    steps[:, scene.wraps] = wrap_angle(steps[:, scene.wraps])
    return steps


def travel(scene: Scene, steps: np.ndarray) -> np.ndarray:
    """Lengths (n,) of displacements (n, d), m; rotations count as in the motion model."""
    return np.linalg.norm(steps * levers(scene), axis=1)


def travelled(scene: Scene, position: np.ndarray) -> np.ndarray:
    """Travel (n,) from the first of the positions (n, d) to each of them, m."""
    return np.concatenate([[0.0], np.cumsum(travel(scene, displacements(scene, position)))])[: len(position)]
