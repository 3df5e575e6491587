"""Simulated sessions of sweeps: the paper's training scan, or test sweeps between its lines."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import ParameterError
from tactile_localizer.io.recording import Recording, scan_of
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.resources import resource_path
from tactile_localizer.scene import Scene
from tactile_localizer.sim.material import SIMULATED_FEATURES
from tactile_localizer.sim.noise import child
from tactile_localizer.sim.sweep import SIDE_M, simulate_sweep

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


def shipped_scene(feature: str, channels: Sequence[int] = ()) -> Scene:
    """The scene of a simulated feature; that of the bump for features without one.

    Parameters
    ----------
    feature : one of :data:`~tactile_localizer.sim.material.FEATURES`
    channels : channels of the two phalanges, if they are not the shipped ones; the scene then has no
        parameters of the measurement model
    """
    name = feature if feature in SIMULATED_FEATURES else SIMULATED_FEATURES[0]
    scene = load_scene(resource_path(f"config/scenes/{name}.yaml"))
    if not channels:
        return scene
    phalanges = zip(scene.phalanges, channels, strict=True)
    counted = tuple(replace(phalanx, channels=count) for phalanx, count in phalanges)
    return replace(scene, name=feature, phalanges=counted)


def simulate_recording(
    feature: str,
    seed: int,
    kind: str = "train",
    *,
    sweeps: int | None = None,
    reach_feature: bool = True,
    **options: Any,
) -> Recording:
    """Simulate a session.

    Parameters
    ----------
    feature : one of :data:`~tactile_localizer.sim.material.FEATURES`
    seed : seed of the session; a sweep's noise depends only on it and on its number, so sessions that are
        to be independent, as at several angles, need different seeds
    kind : ``train`` or ``test``
    sweeps : number of sweeps; default: 21 for training (about 16,300 samples), 18 for test
    reach_feature : if false, every sweep ends before the feature
    options : ``yaw``, ``speed``, ``rate``, ``channels`` of :func:`~.sim.sweep.simulate_sweep`

    Raises
    ------
    ParameterError
        No sweeps, or impossible numbers of channels.
    """
    count = {"train": TRAINING_SWEEPS, "test": TEST_SWEEPS}.get(kind, 1) if sweeps is None else sweeps
    if count < 1:
        raise ParameterError(f"simulated scan: expected at least one sweep, got {count}")
    plan = partial(sweep_plan, kind) if reach_feature else featureless_plan
    recorded = []
    for number in range(count):
        start, end = plan(number, seed)
        recorded.append(simulate_sweep(feature, seed, number, kind, start=start, end=end, **options))
    return Recording(f"simulated {feature}", tuple(recorded))


def simulate_scan(feature: str, seed: int, *, channels: tuple[int, ...] = (), **options: Any) -> Scan:
    """The pairs of a simulated training session, with the arguments of :func:`simulate_recording`."""
    recording = simulate_recording(feature, seed, channels=channels, **options)
    return scan_of(recording, shipped_scene(feature, channels))
