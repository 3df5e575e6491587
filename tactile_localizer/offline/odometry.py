"""Odometry for recordings of the palm's true positions, and random starts in a recording."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tactile_localizer.core.geometry.angles import wrap_angle
from tactile_localizer.core.geometry.motion import levers
from tactile_localizer.errors import ScanError
from tactile_localizer.io.recording import Recording
from tactile_localizer.scene import Scene

SIMULATED, EXACT, RECORDED = "simulated", "exact", "recorded"
"""Kinds of odometry: true displacements with or without the scene's motion noise, or the arm's."""

_ROUNDING = 1e-9
"""Rounding error of a sum of many steps, m."""


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


def random_starts(
    recording: Recording, scene: Scene, count: int, length: float | None, rng: np.random.Generator
) -> Recording:
    """Cut sweeps that begin at random samples out of a recording, numbered from 1.

    Parameters
    ----------
    recording : recording whose positions give the travel
    count : number of sweeps
    length : travel of each, m; ``None``: to the end of the recorded sweep
    rng : draws the first samples

    Raises
    ------
    ScanError
        No recorded sweep is long enough.
    """
    travels = [travelled(scene, sweep.position) for sweep in recording.sweeps]
    left = [along[-1:] - along for along in travels]
    wanted = length - _ROUNDING if length is not None else np.finfo(float).tiny
    starts = [np.flatnonzero(rest >= wanted) for rest in left]
    places = [(index, int(start)) for index, rows in enumerate(starts) for start in rows]
    if not places:
        longest = max((float(rest.max(initial=0.0)) for rest in left), default=0.0)
        expected = "with any travel" if length is None else f"of at least {length * 1e3:.1f} mm"
        raise ScanError(
            f"{recording.source}: expected a sweep {expected} to start in, "
            f"the longest is {longest * 1e3:.1f} mm"
        )
    pieces = []
    for number, place in enumerate(rng.integers(len(places), size=count), start=1):
        index, start = places[place]
        along = travels[index]
        end = len(along) if length is None else int(np.searchsorted(along, along[start] + wanted)) + 1
        pieces.append(recording.sweeps[index].part(slice(start, end), number))
    return replace(recording, sweeps=tuple(pieces))
