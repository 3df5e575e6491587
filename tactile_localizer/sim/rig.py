"""Simulated hand as a function of time: fingers open, closed at the start of a sweep, or sweeping.

Strain and position are functions of simulated time, so several devices can sample them independently, at
any rate and phase.
"""

from dataclasses import dataclass
from enum import Enum

import numpy as np

from tactile_localizer.io.recording import RecordedSweep
from tactile_localizer.sim.contact import contact
from tactile_localizer.sim.load_cell import NOISE_V
from tactile_localizer.sim.material import MODES
from tactile_localizer.sim.noise import child
from tactile_localizer.sim.scan import sweep_plan
from tactile_localizer.sim.sweep import CELLS, KINDS, simulate_sweep

_RETURN_S = 0.6
"""Time of the motion to the start of a sweep, s."""

_CLOSE_S = 0.3
"""Time in which the fingers close, s."""

_NOISE_STREAM = 4 << 30
"""Path of the random generator for the noise outside of sweeps; no sweep has so high a number."""


class Phase(Enum):
    """State of the hand."""

    OPEN = "open"
    """The fingers are off the material: at home, or moving to the start of a sweep."""
    READY = "ready"
    """The fingers are closed, or closing, at the start of a sweep."""
    SWEEPING = "sweeping"
    DONE = "done"
    """The fingers are still closed at the end of the sweep."""


@dataclass(frozen=True)
class Reading:
    """State of the hand at one time.

    Parameters
    ----------
    phase : phase of the sweep
    strain : (16,) strain voltages, V
    odometry : (2,) palm position reported by the arm, m
    truth : (2,) palm position relative to the material, m; ``None`` while the fingers are open
    """

    phase: Phase
    strain: np.ndarray
    odometry: np.ndarray
    truth: np.ndarray | None


class Rig:
    """A hand, a piece of material and a sequence of sweeps.

    Parameters
    ----------
    feature : one of :data:`~tactile_localizer.sim.material.FEATURES`
    seed : seed of all random processes
    speed : speed of the palm in a sweep, m/s
    rate : sampling rate of the strain in simulated time, Hz
    """

    def __init__(self, feature: str, seed: int, speed: float, rate: float) -> None:
        self._feature, self._seed = feature, seed
        self._speed, self._rate = speed, rate
        self._rng = child(seed, _NOISE_STREAM)
        self._made = dict.fromkeys(KINDS, 0)
        self._unloaded = np.concatenate([cell.bias for cell in CELLS])
        self._sweep: RecordedSweep | None = None
        self._from = np.zeros(2)
        self._prepared_s = self._started_s = np.inf
        for mode in MODES:  # compute the contact tables now rather than in real time
            contact(feature, mode, np.zeros(1), np.zeros(1))

    @property
    def ready_s(self) -> float:
        """Time at which the fingers are closed at the start of the sweep that was prepared last, s."""
        return self._prepared_s + _RETURN_S + _CLOSE_S

    def prepare(self, kind: str, now_s: float) -> RecordedSweep:
        """Open the fingers at ``now_s``, move to the start of the next sweep of ``kind``, and close them."""
        here = self.read(now_s).odometry
        number = self._made[kind]
        start, end = sweep_plan(kind, number, self._seed)
        self._sweep = simulate_sweep(
            self._feature, self._seed, number, kind, start=start, end=end, speed=self._speed, rate=self._rate
        )
        self._made[kind] += 1
        self._from, self._prepared_s, self._started_s = here, now_s, np.inf
        return self._sweep

    def start(self, now_s: float) -> None:
        """Begin the prepared sweep at ``now_s``, but not before :attr:`ready_s`."""
        self._started_s = max(now_s, self.ready_s)

    def read(self, now_s: float) -> Reading:
        """State of the hand at time ``now_s``."""
        sweep = self._sweep
        if sweep is None:
            return Reading(Phase.OPEN, self._with_noise(self._unloaded), self._from, None)
        if now_s < self.ready_s:
            return self._approach(sweep, now_s - self._prepared_s)
        last = len(sweep.stamp_ns) - 1
        assert sweep.truth is not None
        index = np.clip((now_s - self._started_s) * self._rate, 0, last)
        before = int(index)
        after = min(before + 1, last)
        phase = Phase.READY if now_s < self._started_s else Phase.DONE if index >= last else Phase.SWEEPING
        strain = sweep.strain[round(index)]
        return Reading(
            phase,
            strain if phase is Phase.SWEEPING else self._with_noise(strain),
            _interpolate(sweep.position[before], sweep.position[after], index - before),
            _interpolate(sweep.truth[before], sweep.truth[after], index - before),
        )

    def _approach(self, sweep: RecordedSweep, since_s: float) -> Reading:
        moved = np.clip(since_s / _RETURN_S, 0, 1)
        closed = np.clip((since_s - _RETURN_S) / _CLOSE_S, 0, 1)
        odometry = _interpolate(self._from, sweep.position[0], moved * moved * (3 - 2 * moved))
        strain = self._with_noise(_interpolate(self._unloaded, sweep.strain[0], closed))
        truth = None if closed == 0 or sweep.truth is None else sweep.truth[0]
        return Reading(Phase.OPEN if truth is None else Phase.READY, strain, odometry, truth)

    def _with_noise(self, strain: np.ndarray) -> np.ndarray:
        return strain + NOISE_V * self._rng.standard_normal(len(strain))


def _interpolate(a: np.ndarray, b: np.ndarray, fraction: float) -> np.ndarray:
    return np.asarray(a + fraction * (b - a))
