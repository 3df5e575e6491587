"""One sweep of the simulated hand over the simulated material, as a recording."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_localizer.channels import DEFAULT_CHANNELS
from tactile_localizer.errors import ParameterError
from tactile_localizer.scene import MOST_CHANNELS
from tactile_localizer.sim.deformation import deformation, mode_of_sweep
from tactile_localizer.sim.hand import Sliding, feel
from tactile_localizer.sim.load_cell import NOISE_V, LoadCell, drift, load_cell, sensor
from tactile_localizer.sim.material import FEATURES
from tactile_localizer.sim.motion import FIXTURED, HANGING, sweep_motion
from tactile_localizer.sim.noise import child

SIDE_M = 0.0508
"""Side of the square that the palm moves in: two inches."""

FEATURE_CENTER_M = (32.0e-3, 25.4e-3)
"""Where the feature lies in the material."""

SPEED_MPS = 6.8e-3
RATE_HZ = 100.0

KINDS = ("train", "test")
"""Training: fixtured material, odometry from a known origin. Test: hanging material, unknown origin."""

_SERIALS = (101, 102)
CELLS = tuple(load_cell(serial) for serial in _SERIALS)
"""The load cells of :data:`~tactile_localizer.sim.hand.PHALANGES`."""

_FELT_V = 40e-3
"""A feature is felt from three sigma of what featureless stretches differ between sweeps (about 13 mV)."""

_FIRST_STAMP_NS = 1_000_000_000
_PAUSE_S = 3.0
_UNKNOWN_ORIGIN_M = 0.3
_MODES, _DRIFT = 1 << 30, 2 << 30


@dataclass(frozen=True)
class SimulatedSweep:
    """A recorded sweep of n samples.

    Parameters
    ----------
    number : of the sweep in its scan
    stamp_ns : (n,) int64
    truth : (n, 2) m, palm relative to the material, x and y
    odometry : (n, 2) m, palm as the arm reports it: wrong by the material's motion, for a test sweep
        also by a constant that nobody knows
    strain : (n, C) V, index then middle
    contact, feature_end : first and last sample at which a pad feels the feature above noise; -1: none
    """

    number: int
    stamp_ns: np.ndarray
    truth: np.ndarray
    odometry: np.ndarray
    strain: np.ndarray
    contact: int
    feature_end: int


def simulate_sweep(
    feature: str,
    seed: int,
    number: int = 0,
    kind: str = "test",
    *,
    start: tuple[float, float] = (0.0, SIDE_M / 2),
    end: tuple[float, float] | None = None,
    speed: float = SPEED_MPS,
    rate: float = RATE_HZ,
    channels: tuple[int, ...] = (),
) -> SimulatedSweep:
    """Simulate one sweep; the same arguments give the same recording, whatever was simulated before.

    Parameters
    ----------
    feature : one of :data:`~tactile_localizer.sim.material.FEATURES`
    seed, number : of the session and of the sweep in it
    kind : one of :data:`KINDS`
    start, end : m, where the palm is meant to go; without ``end`` straight along x to the square's far side
    speed : m/s
    rate : samples per second
    channels : of the two phalanges' sensors; empty: those of :data:`CELLS`

    Raises
    ------
    ParameterError
        No such feature or kind, a sweep without length, a speed or rate that is not positive.
    """
    _require(feature, kind, speed, rate)
    end = (SIDE_M, start[1]) if end is None else end
    if np.allclose(start, end):
        raise ParameterError(f"sweep {number}: expected an end away from its start {start}, got {end}")
    session = (FEATURES.index(feature), KINDS.index(kind))
    rng = child(seed, *session, number)
    motion = sweep_motion(rng, start, end, speed, rate, FIXTURED if kind == "train" else HANGING)

    mode = mode_of_sweep(child(seed, *session, _MODES), number)
    place = motion.truth - FEATURE_CENTER_M
    lie = deformation(rng, mode, place[:, 0], spacing=speed / rate)
    sliding = Sliding(place, motion.yaw, motion.direction, motion.tension, speed / rate, 1 / rate)
    wrench, departure = feel(feature, sliding, lie, rng)

    begin_s = number * (SIDE_M / speed + _PAUSE_S)
    cells = sensors(channels)
    strain = np.hstack([cell.strain(wrench[:, f]) for f, cell in enumerate(cells)])
    strain += drift(child(seed, *session, _DRIFT), begin_s + motion.time, strain.shape[1])
    strain += NOISE_V * rng.standard_normal(strain.shape)

    signal = [np.abs(departure[:, f] @ cell.gain.T).max(axis=1) for f, cell in enumerate(cells)]
    felt = np.flatnonzero(np.max(signal, axis=0) > _FELT_V)
    contact, feature_end = (int(felt[0]), int(felt[-1])) if len(felt) else (-1, -1)
    unknown = rng.uniform(-_UNKNOWN_ORIGIN_M, _UNKNOWN_ORIGIN_M, 2) if kind == "test" else np.zeros(2)
    stamp_ns = _FIRST_STAMP_NS + np.round((begin_s + motion.time) * 1e9).astype(np.int64)
    return SimulatedSweep(
        number, stamp_ns, motion.truth, motion.odometry + unknown, strain, contact, feature_end
    )


def sensors(channels: tuple[int, ...]) -> tuple[LoadCell, ...]:
    """The sensors of the two phalanges, with so many channels; empty: the load cells.

    Raises
    ------
    ParameterError
        Other than two numbers, or a number that no sensor has.
    """
    if channels and (len(channels) != len(_SERIALS) or not all(1 <= n <= MOST_CHANNELS for n in channels)):
        raise ParameterError(
            f"channels: expected {len(_SERIALS)} numbers of 1 to {MOST_CHANNELS}, got {list(channels)}"
        )
    counts = channels or (DEFAULT_CHANNELS,) * len(_SERIALS)
    return tuple(sensor(serial, count) for serial, count in zip(_SERIALS, counts, strict=True))


def _require(feature: str, kind: str, speed: float, rate: float) -> None:
    if feature not in FEATURES:
        raise ParameterError(f"feature {feature!r}: expected one of {', '.join(FEATURES)}")
    if kind not in KINDS:
        raise ParameterError(f"sweep kind {kind!r}: expected one of {', '.join(KINDS)}")
    for name, value in (("speed", speed), ("rate", rate)):
        if not (np.isfinite(value) and value > 0):
            raise ParameterError(f"sweep {name}: expected a positive number, got {value}")
