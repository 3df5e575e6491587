"""Odometry for recordings that hold only the true positions of the palm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tactile_localizer.core.geometry.angles import wrap_angle
from tactile_localizer.core.geometry.motion import levers
from tactile_localizer.errors import ScanError
from tactile_localizer.io.recording import Recording
from tactile_localizer.scene import Scene

SIMULATED, EXACT, RECORDED = "simulated", "exact", "recorded"
"""Kinds of odometry: true displacements with the scene's motion noise, without it, or those of the arm."""

_ROUNDING = 1e-9
"""Rounding error of a sum of many steps, m."""


def with_odometry(recording: Recording, scene: Scene, rng: np.random.Generator, kind: str) -> Recording:
    """The recording with odometry as its positions, and its positions as the truth.

    Parameters
    ----------
    recording : its positions are the truth
    scene : gives the motion noise: variance ``motion_std**2`` per metre of travel, on each axis
    rng : of the noise
    kind : :data:`SIMULATED` or :data:`EXACT`

    Returns
    -------
    Recording
        Each sweep's odometry starts at zero, so that it does not contain the position of the palm.
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
    """Steps between positions (n, d), (n - 1, d); yaw along the shortest arc."""
    steps = np.diff(position, axis=0)
    steps[:, scene.wraps] = wrap_angle(steps[:, scene.wraps])
    return steps


def travel(scene: Scene, steps: np.ndarray) -> np.ndarray:
    """Lengths of displacements (n, d), m: (n,); a turn counts as in the motion model."""
    return np.linalg.norm(steps * levers(scene), axis=1)


def travelled(scene: Scene, position: np.ndarray) -> np.ndarray:
    """Travel from the first of the positions (n, d) to each of them, m: (n,)."""
    return np.concatenate([[0.0], np.cumsum(travel(scene, displacements(scene, position)))])[: len(position)]


def random_starts(
    recording: Recording, scene: Scene, count: int, length: float | None, rng: np.random.Generator
) -> Recording:
    """Parts of a recording that begin at random samples, numbered from 1.

    Parameters
    ----------
    recording : its positions give the travel
    count : number of parts
    length : m, of each part; ``None``: to the end of its sweep. No part begins where less is left.
    rng : draws the first samples

    Raises
    ------
    ScanError
        No sweep is long enough.
    """
    ways = [travelled(scene, sweep.position) for sweep in recording.sweeps]
    left = [way[-1:] - way for way in ways]
    wanted = length - _ROUNDING if length is not None else np.finfo(float).tiny
    starts = [np.flatnonzero(rest >= wanted) for rest in left]
    places = [(index, int(start)) for index, own in enumerate(starts) for start in own]
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
        way = ways[index]
        end = len(way) if length is None else int(np.searchsorted(way, way[start] + wanted)) + 1
        pieces.append(recording.sweeps[index].part(slice(start, end), number))
    return replace(recording, sweeps=tuple(pieces))
