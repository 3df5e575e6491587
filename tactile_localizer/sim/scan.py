"""Simulated sessions of sweeps: the paper's training scan, or test sweeps between its lines."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import ParameterError
from tactile_localizer.sim.hand import PHALANGES
from tactile_localizer.sim.noise import child
from tactile_localizer.sim.sweep import RATE_HZ, SIDE_M, SPEED_MPS, SimulatedSweep, simulate_sweep

AXES = ("x", "y")
"""Axes of the simulated state: along the sweeps and across them."""

TRAINING_SWEEPS = 21
"""Sweeps of a training scan, 2.54 mm (0.1 inch) apart across the square, as in the paper."""

TEST_SWEEPS = 18
"""Sweeps of a test session, as in the paper."""

_PLAN_STREAM = 3 << 30
"""Path of the random generator for the plan of test sweeps; no sweep has so high a number."""

_LATEST_START_M = 8.0e-3
"""Largest x at which a test sweep starts, m: well before the feature."""

_FEATURELESS_END_M = 13.0e-3
"""End of sweeps that stop before the feature, m along x."""


@dataclass(frozen=True)
class SimulatedScan:
    """Consecutive sweeps of a session, with N samples in S sweeps.

    Parameters
    ----------
    feature : feature in the material
    stamp_ns : (N,) int64 stamps, ns
    truth : (N, 2) palm position relative to the material, m
    odometry : (N, 2) palm position reported by the arm, m
    strain : (N, C) strain voltages, V
    sweep : (N,) sweep number of each sample
    contact, feature_end : (S,) indices of the samples at which the first pad of a sweep comes into contact
        with the feature, and the last one leaves it; -1 without contact
    channels : channels of the two phalanges; empty: the default for each
    """

    feature: str
    stamp_ns: np.ndarray
    truth: np.ndarray
    odometry: np.ndarray
    strain: np.ndarray
    sweep: np.ndarray
    contact: np.ndarray
    feature_end: np.ndarray
    channels: tuple[int, ...] = ()

    def __len__(self) -> int:
        return len(self.stamp_ns)

    @property
    def layout(self) -> ChannelLayout:
        """Channels of the strain vector by phalanx."""
        return ChannelLayout.of(self.channels, len(PHALANGES))

    @property
    def felt(self) -> np.ndarray:
        """Which samples lie between contact and the feature's end, (N,) bool."""
        felt = np.zeros(len(self), dtype=bool)
        for first, last in zip(self.contact, self.feature_end, strict=True):
            if first >= 0:
                felt[first : last + 1] = True
        return felt

    def to_scan(self) -> Scan:
        """Training pairs: strain with the position reported by the arm."""
        return Scan(self.odometry, self.strain, self.sweep, AXES, PHALANGES, self.channels)

    def slices(self) -> list[slice]:
        """Slice of the arrays for each sweep."""
        starts = np.flatnonzero(np.diff(self.sweep, prepend=-1))
        return [slice(a, b) for a, b in zip(starts, [*starts[1:], len(self)], strict=True)]


def sweep_plan(kind: str, number: int, seed: int) -> tuple[tuple[float, float], tuple[float, float]]:
    """Nominal start and end of sweep ``number`` of a session, m.

    Training sweeps are 2.54 mm apart and start again after the last line. Test sweeps start at random
    positions before the feature, between the lines of the training scan.
    """
    spacing = SIDE_M / (TRAINING_SWEEPS - 1)
    if kind == "train":
        y = spacing * (number % TRAINING_SWEEPS)
        return (0.0, y), (SIDE_M, y)
    rng = child(seed, _PLAN_STREAM, number)
    y = spacing * (rng.integers(TRAINING_SWEEPS - 1) + rng.uniform(0.2, 0.8))
    return (rng.uniform(0, _LATEST_START_M), y), (SIDE_M - rng.uniform(0, 1e-3), y)


def featureless_plan(number: int, seed: int) -> tuple[tuple[float, float], tuple[float, float]]:
    """Nominal start and end of a test sweep that stops before the feature, m."""
    (x, y), _ = sweep_plan("test", number, seed)
    return (0.25 * x, y), (_FEATURELESS_END_M, y)


def simulate_scan(
    feature: str,
    seed: int,
    kind: str = "train",
    *,
    sweeps: int | None = None,
    reach_feature: bool = True,
    yaw: float = 0.0,
    speed: float = SPEED_MPS,
    rate: float = RATE_HZ,
    channels: tuple[int, ...] = (),
) -> SimulatedScan:
    """Simulate a session.

    Parameters
    ----------
    feature : one of :data:`~tactile_localizer.sim.material.FEATURES`
    seed : seed of the session; a sweep's noise depends only on it and on its number, so sessions that are
        to be independent, as at several angles, need different seeds
    kind : ``train`` or ``test``
    sweeps : number of sweeps; default: 21 for training (about 16,300 samples), 18 for test
    reach_feature : if false, every sweep ends before the feature
    yaw : nominal rotation of the hand, rad
    speed : speed of the palm, m/s
    rate : sampling rate, Hz
    channels : channels of the two phalanges; empty: load cells with 8 each

    Raises
    ------
    ParameterError
        No such feature or kind, no sweeps, a speed or rate that is not positive.
    """
    count = {"train": TRAINING_SWEEPS, "test": TEST_SWEEPS}.get(kind, 1) if sweeps is None else sweeps
    if count < 1:
        raise ParameterError(f"simulated scan: expected at least one sweep, got {count}")
    plan = partial(sweep_plan, kind) if reach_feature else featureless_plan
    options: dict[str, Any] = {"yaw": yaw, "speed": speed, "rate": rate, "channels": channels}
    recorded = []
    for number in range(count):
        start, end = plan(number, seed)
        recorded.append(simulate_sweep(feature, seed, number, kind, start=start, end=end, **options))
    return _join(feature, recorded, channels)


def _join(feature: str, sweeps: list[SimulatedSweep], channels: tuple[int, ...]) -> SimulatedScan:
    lengths = [len(sweep.stamp_ns) for sweep in sweeps]
    before = np.cumsum([0, *lengths[:-1]])
    contact = np.array([(sweep.contact, sweep.feature_end) for sweep in sweeps])
    contact = np.where(contact < 0, -1, contact + before[:, None])
    samples = {
        name: np.concatenate([getattr(sweep, name) for sweep in sweeps])
        for name in ("stamp_ns", "truth", "odometry", "strain")
    }
    number = np.repeat([sweep.number for sweep in sweeps], lengths)
    return SimulatedScan(
        feature, **samples, sweep=number, contact=contact[:, 0], feature_end=contact[:, 1], channels=channels
    )
