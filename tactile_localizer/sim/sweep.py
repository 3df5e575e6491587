"""Simulation of one sweep of the hand over the material."""

import numpy as np

from tactile_localizer.channels import DEFAULT_CHANNELS
from tactile_localizer.errors import ParameterError
from tactile_localizer.io.recording import RecordedSweep
from tactile_localizer.io.status import OK
from tactile_localizer.scene import MOST_CHANNELS
from tactile_localizer.sim.deformation import deformation, mode_of_sweep
from tactile_localizer.sim.hand import Sliding, contact_wrenches
from tactile_localizer.sim.load_cell import NOISE_V, LoadCell, drift, load_cell, sensor
from tactile_localizer.sim.material import FEATURES
from tactile_localizer.sim.motion import FIXTURED, HANGING, sweep_motion
from tactile_localizer.sim.noise import child

SIDE_M = 0.0508
"""Side of the square in which the palm moves, m: two inches, as in the paper."""

FEATURE_CENTER_M = (32.0e-3, 25.4e-3)
"""Centre of the feature in the material, m."""

SPEED_MPS = 6.8e-3
RATE_HZ = 100.0
"""Nominal speed and sampling rate; with them a training scan has the number of samples of the paper's."""

KINDS = ("train", "test")
"""Training: fixtured material, odometry with known origin. Test: hanging material, unknown origin."""

_SERIALS = (101, 102)
CELLS = tuple(load_cell(serial) for serial in _SERIALS)
"""Load cells of :data:`~tactile_localizer.sim.hand.PHALANGES`."""

_CONTACT_THRESHOLD_V = 40e-3
"""Strain from which a feature counts as in contact, V: three standard deviations (13 mV) of featureless
material between sweeps.
"""

_FIRST_STAMP_NS = 1_000_000_000
_PAUSE_S = 3.0
"""Pause between sweeps, s."""

_MAX_ORIGIN_OFFSET_M = 0.3
"""Largest offset of the odometry in a test sweep, m."""

_MODE_STREAM, _DRIFT_STREAM = 1 << 30, 2 << 30
"""Paths of the random generators for modes and drift; no sweep has so high a number."""


def simulate_sweep(
    feature: str,
    seed: int,
    number: int = 0,
    kind: str = "test",
    *,
    start: tuple[float, float] = (0.0, SIDE_M / 2),
    end: tuple[float, float] | None = None,
    yaw: float = 0.0,
    speed: float = SPEED_MPS,
    rate: float = RATE_HZ,
    channels: tuple[int, ...] = (),
) -> RecordedSweep:
    """Simulate one sweep; the result depends on the arguments only.

    Parameters
    ----------
    feature : one of :data:`~tactile_localizer.sim.material.FEATURES`
    seed, number : seed of the session, and number of the sweep in it
    kind : one of :data:`KINDS`
    start, end : nominal start and end of the palm, m; default of ``end``: along x to the far side of the
        square
    yaw : nominal rotation of the hand about the palm, in the plane of the material, rad
    speed : speed of the palm, m/s
    rate : sampling rate, Hz
    channels : channels of the two phalanges; empty: those of :data:`CELLS`

    Returns
    -------
    RecordedSweep
        Its positions are what the arm reports; their error is the motion of the material and, in a test
        sweep, an unknown constant. ``felt`` is true from the first sample with a pad in contact with the
        feature to the last one.

    Raises
    ------
    ParameterError
        Impossible numbers of channels.
    """
    end = (SIDE_M, start[1]) if end is None else end
    session = (FEATURES.index(feature), KINDS.index(kind))
    rng = child(seed, *session, number)
    motion = sweep_motion(rng, start, end, speed, rate, FIXTURED if kind == "train" else HANGING)

    mode = mode_of_sweep(child(seed, *session, _MODE_STREAM), number)
    position = motion.truth - FEATURE_CENTER_M
    deformed = deformation(rng, mode, position[:, 0], spacing=speed / rate)
    sliding = Sliding(
        position, yaw + motion.yaw, motion.direction, motion.tension, speed / rate, 1 / rate, yaw
    )
    wrench, departure = contact_wrenches(feature, sliding, deformed, rng)

    begin_s = number * (SIDE_M / speed + _PAUSE_S)
    cells = sensors(channels)
    strain = np.hstack([cell.strain(wrench[:, f]) for f, cell in enumerate(cells)])
    strain += drift(child(seed, *session, _DRIFT_STREAM), begin_s + motion.time, strain.shape[1])
    strain += NOISE_V * rng.standard_normal(strain.shape)

    signal = [np.abs(departure[:, f] @ cell.gain.T).max(axis=1) for f, cell in enumerate(cells)]
    touching = np.max(signal, axis=0) > _CONTACT_THRESHOLD_V
    felt = np.maximum.accumulate(touching) & np.maximum.accumulate(touching[::-1])[::-1]
    limit = _MAX_ORIGIN_OFFSET_M
    origin = rng.uniform(-limit, limit, 2) if kind == "test" else np.zeros(2)
    stamp_ns = _FIRST_STAMP_NS + np.round((begin_s + motion.time) * 1e9).astype(np.int64)
    status = np.full((len(strain), len(cells)), OK, dtype=np.uint8)
    return RecordedSweep(
        number, stamp_ns, motion.odometry + origin, strain, status, truth=motion.truth, felt=felt
    )


def sensors(channels: tuple[int, ...]) -> tuple[LoadCell, ...]:
    """Sensors of the two phalanges with the given numbers of channels; empty: the load cells.

    Raises
    ------
    ParameterError
        Not two numbers, or a number out of range.
    """
    if channels and (len(channels) != len(_SERIALS) or not all(1 <= n <= MOST_CHANNELS for n in channels)):
        raise ParameterError(
            f"channels: expected {len(_SERIALS)} numbers of 1 to {MOST_CHANNELS}, got {list(channels)}"
        )
    counts = channels or (DEFAULT_CHANNELS,) * len(_SERIALS)
    return tuple(sensor(serial, count) for serial, count in zip(_SERIALS, counts, strict=True))
