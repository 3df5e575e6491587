"""Odometry for recordings of the palm's true positions."""

from dataclasses import replace

import numpy as np

from tactile_localizer.core.geometry.motion import MotionModel
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
    motion, sweeps = MotionModel(scene), []
    for sweep in recording.sweeps:
        steps = motion.wrapped(np.diff(sweep.position, axis=0))
        if kind == SIMULATED:
            spread = np.sqrt(motion.travels(steps))[:, None] * scene.motion_std
            steps += rng.standard_normal(steps.shape) * spread
        odometry = np.vstack([np.zeros((1, scene.dimension)), np.cumsum(steps, axis=0)])[: len(sweep)]
        sweeps.append(replace(sweep, position=odometry, truth=sweep.position))
    return replace(recording, sweeps=tuple(sweeps))


def travelled(scene: Scene, position: np.ndarray) -> np.ndarray:
    """Travel (n,) from the first of the positions (n, d) to each of them, m."""
    motion = MotionModel(scene)
    steps = np.diff(position, axis=0, prepend=position[:1])
    return np.cumsum(motion.travels(motion.wrapped(steps)))
