"""Conditions of an evaluation: simulated features, or recordings on a scan."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np

from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.io.recording import RecordedSweep, Recording, missing_status
from tactile_localizer.io.scene_file import load_scene, scene_to_dict
from tactile_localizer.offline.odometry import SIMULATED, random_starts, with_odometry
from tactile_localizer.resources import resource_path
from tactile_localizer.scene import Scene
from tactile_localizer.sim import SimulatedScan, simulate_scan
from tactile_localizer.sim.hand import PHALANGES
from tactile_localizer.sim.scan import AXES


@dataclass(frozen=True)
class Material:
    """Scan of a map, and sweeps to localize on it.

    Parameters
    ----------
    scan, scene : scan and scene of the map
    recording : sweeps with odometry and truth
    blank : sweeps that do not reach the feature, or ``None``
    """

    scan: Scan
    scene: Scene
    recording: Recording
    blank: Recording | None = None


@dataclass(frozen=True)
class SimulatedCondition:
    """Test sweeps over a simulated feature, with a training scan of the same seed.

    Parameters
    ----------
    name : one of :data:`~tactile_localizer.sim.material.SIMULATED_FEATURES`
    seed : seed of the simulation and of the filter
    sweeps : number of test sweeps over the feature
    blanks : number of sweeps that end before it
    """

    name: str
    seed: int
    sweeps: int = 18
    blanks: int = 18

    @property
    def identity(self) -> dict[str, Any]:
        """Values that identify the condition."""
        return dict(vars(self))

    @property
    def map_identity(self) -> dict[str, Any]:
        """Name and seed, which determine the scan."""
        return {"name": self.name, "seed": self.seed}

    def load(self) -> Material:
        """Simulate the scan and the sweeps."""
        return _simulate(self)


@lru_cache(maxsize=3)
def _simulate(condition: SimulatedCondition) -> Material:
    feature, seed = condition.name, condition.seed
    test = simulate_scan(feature, seed, "test", sweeps=condition.sweeps)
    blank = None
    if condition.blanks:
        ends_early = simulate_scan(feature, seed, "test", sweeps=condition.blanks, reach_feature=False)
        blank = recording_of(ends_early)
    return Material(
        scan=simulate_scan(feature, seed).to_scan(),
        scene=load_scene(resource_path(f"config/scenes/{feature}.yaml")),
        recording=recording_of(test),
        blank=blank,
    )


def recording_of(scan: SimulatedScan) -> Recording:
    """Simulated sweeps as a recording of the arm's positions, with the truth."""
    sweeps = tuple(
        RecordedSweep(
            number=int(scan.sweep[part.start]),
            stamp_ns=scan.stamp_ns[part],
            position=scan.odometry[part],
            strain=scan.strain[part],
            status=missing_status(scan.strain[part], scan.layout),
            truth=scan.truth[part],
            felt=scan.felt[part],
        )
        for part in scan.slices()
    )
    return Recording(f"simulated {scan.feature}", AXES, PHALANGES, sweeps, channels=scan.channels)


@dataclass(frozen=True, eq=False)
class RecordedCondition:
    """A recording on a scan.

    Parameters
    ----------
    name : name in tables and figures
    seed : seed of the odometry noise and of the filter
    scan, scene : scan and scene of the map
    recording : recording whose positions are the truth, unless it has a separate truth
    starts, travel : number of random starts and their travel, m; ``None``: the sweeps as recorded
    """

    name: str
    seed: int
    scan: Scan
    scene: Scene
    recording: Recording
    starts: int | None = None
    travel: float | None = None

    @property
    def identity(self) -> dict[str, Any]:
        """Values that identify the condition, with digests of its arrays."""
        sweeps = [
            known
            for sweep in self.recording.sweeps
            for known in (sweep.stamp_ns, sweep.position, sweep.strain, sweep.status, sweep.truth)
            if known is not None
        ]
        return {
            **self.map_identity,
            "name": self.name,
            "seed": self.seed,
            "starts": self.starts,
            "travel": self.travel,
            "data": _digest(sweeps),
        }

    @property
    def map_identity(self) -> dict[str, Any]:
        """The scene and a digest of the scan."""
        scan = _digest([self.scan.states, self.scan.strain, self.scan.sweep])
        return {"scene": scene_to_dict(self.scene), "scan": scan}

    def load(self) -> Material:
        """Add odometry to the recording, from random starts if requested."""
        recording, rng = self.recording, np.random.default_rng([self.seed, 1])
        if self.starts is not None:
            recording = random_starts(recording, self.scene, self.starts, self.travel, rng)
        if any(sweep.truth is None for sweep in recording.sweeps):
            recording = with_odometry(recording, self.scene, rng, SIMULATED)
        return Material(self.scan, self.scene, recording)


Condition: TypeAlias = SimulatedCondition | RecordedCondition
"""A named map and its sweeps, with a random seed. Calibrations of equal ``map_identity`` are equal."""


def _digest(arrays: Sequence[np.ndarray]) -> str:
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()
