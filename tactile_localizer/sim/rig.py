"""The simulated hand as it goes on in time: fingers open, at rest on the material, sweeping.

What it feels and where it is are functions of simulated time, so that any number of devices may look at
any rate and phase, late or early, and always find something true of the moment.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from tactile_localizer.errors import ParameterError
from tactile_localizer.sim.contact import contact
from tactile_localizer.sim.load_cell import NOISE_V
from tactile_localizer.sim.material import MODES
from tactile_localizer.sim.noise import child
from tactile_localizer.sim.scan import sweep_plan
from tactile_localizer.sim.sweep import CELLS, KINDS, SimulatedSweep, simulate_sweep

_RETURN_S = 0.6
_CLOSE_S = 0.3
_OTHER_NOISE = 4 << 30


class Phase(Enum):
    """What the hand is doing."""

    OPEN = "open"
    """The fingers are off the material: at home, or on the way to a sweep's start."""
    READY = "ready"
    """The fingers are closed (or closing) at a sweep's start."""
    SWEEPING = "sweeping"
    DONE = "done"
    """The fingers are still closed at the sweep's end."""


@dataclass(frozen=True)
class Reading:
    """A moment.

    Parameters
    ----------
    phase : what the hand is doing
    strain : (16,) V
    odometry : (2,) m, palm as the arm reports it
    truth : (2,) m, palm relative to the material; None while the fingers do not hold it
    """

    phase: Phase
    strain: np.ndarray
    odometry: np.ndarray
    truth: np.ndarray | None


class Rig:
    """A hand, a piece of material and a plan of sweeps.

    Parameters
    ----------
    feature : one of :data:`~tactile_localizer.sim.material.FEATURES`
    seed : of everything random
    speed : m/s of the palm in a sweep
    rate : strain samples per second of simulated time

    Raises
    ------
    ParameterError
        No such feature, a speed or rate that is not positive.
    """

    def __init__(self, feature: str, seed: int, speed: float, rate: float) -> None:
        self._feature, self._seed = feature, seed
        self._speed, self._rate = speed, rate
        self._rng = child(seed, _OTHER_NOISE)
        self._made = dict.fromkeys(KINDS, 0)
        self._unloaded = np.concatenate([cell.bias for cell in CELLS])
        self._sweep: SimulatedSweep | None = None
        self._from = np.zeros(2)
        self._prepared_s = self._started_s = np.inf
        simulate_sweep(feature, seed, speed=speed, rate=rate)  # raises what is wrong with the arguments
        for mode in MODES:  # solved now, not in the middle of time
            contact(feature, mode, np.zeros(1), np.zeros(1))

    @property
    def duration_s(self) -> float:
        """Of the sweep that was prepared last, s; 0 before the first."""
        return 0.0 if self._sweep is None else (len(self._sweep.stamp_ns) - 1) / self._rate

    @property
    def ready_s(self) -> float:
        """When the fingers are closed at the start of the sweep that was prepared last."""
        return self._prepared_s + _RETURN_S + _CLOSE_S

    def prepare(self, kind: str, now_s: float) -> SimulatedSweep:
        """Let go, go to the start of the next sweep of ``kind``, and close the fingers, from ``now_s`` on."""
        if kind not in KINDS:
            raise ParameterError(f"sweep kind {kind!r}: expected one of {', '.join(KINDS)}")
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
        """Begin the prepared sweep at ``now_s``, which is not before :attr:`ready_s`."""
        self._started_s = max(now_s, self.ready_s)

    def read(self, now_s: float) -> Reading:
        """The moment ``now_s``."""
        sweep = self._sweep
        if sweep is None:
            return Reading(Phase.OPEN, self._with_noise(self._unloaded), self._from, None)
        if now_s < self.ready_s:
            return self._approach(sweep, now_s - self._prepared_s)
        last = len(sweep.stamp_ns) - 1
        index = np.clip((now_s - self._started_s) * self._rate, 0, last)
        whole = int(index)
        after = min(whole + 1, last)
        phase = Phase.READY if now_s < self._started_s else Phase.DONE if index >= last else Phase.SWEEPING
        strain = sweep.strain[round(index)]
        return Reading(
            phase,
            strain if phase is Phase.SWEEPING else self._with_noise(strain),
            _between(sweep.odometry[whole], sweep.odometry[after], index - whole),
            _between(sweep.truth[whole], sweep.truth[after], index - whole),
        )

    def _approach(self, sweep: SimulatedSweep, since_s: float) -> Reading:
        way = np.clip(since_s / _RETURN_S, 0, 1)
        closed = np.clip((since_s - _RETURN_S) / _CLOSE_S, 0, 1)
        odometry = _between(self._from, sweep.odometry[0], way * way * (3 - 2 * way))
        strain = self._with_noise(_between(self._unloaded, sweep.strain[0], closed))
        if closed > 0:
            return Reading(Phase.READY, strain, odometry, sweep.truth[0])
        return Reading(Phase.OPEN, strain, odometry, None)

    def _with_noise(self, strain: np.ndarray) -> np.ndarray:
        return strain + NOISE_V * self._rng.standard_normal(len(strain))


def _between(a: np.ndarray, b: np.ndarray, share: float) -> np.ndarray:
    return np.asarray(a + share * (b - a))
