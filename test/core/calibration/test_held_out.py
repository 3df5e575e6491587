"""Registration error, from sweeps that are registered to the others."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from support.models import KalmanFilter, LinearModel, whitened_scan
from support.scans import slides

from tactile_localizer.core.calibration.held_out import (
    register,
    registration_errors,
    registration_std,
    surroundings,
)
from tactile_localizer.core.calibration.sweep_model import SweepModel, learn_sweep_model
from tactile_localizer.core.likelihood.strain_map import VarianceModel
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Axis, Phalanx, Scene

LENGTH = 0.1
SCENE = Scene("cloth", (Axis("x", 0.0, LENGTH),), (Phalanx("index", (0.0,)),))


def cloth(shift: float, repeats: int = 6, seed: int = 0) -> Scan:
    """Slides over waves of 10 to 40 mm, whose positions are off by ``shift`` m to either side."""
    rng = np.random.default_rng(seed)
    x = np.arange(0.0, LENGTH, 0.0005)
    waves, phase = np.linspace(150.0, 600.0, 8), np.arange(8.0)
    off = shift * (1.0 - 2.0 * (np.arange(repeats) % 2))
    strain = [
        10.0 * np.sin((x[:, None] + each) * waves + phase) + rng.standard_normal((len(x), 8)) for each in off
    ]
    return slides(SCENE, x, strain)


def registration_of(scan: Scan) -> float:
    """Registration error, m."""
    return float(registration_errors(learn_sweep_model(scan, SCENE), 0.0065)[0])


def test_shifted_sweeps_give_the_registration_error() -> None:
    registration = {shift: registration_of(cloth(shift)) for shift in (0.0, 0.003)}
    assert registration[0.0] < 0.0011
    assert registration[0.003] == pytest.approx(0.002, rel=0.2)


def test_a_featureless_approach_does_not_affect_the_registration_error() -> None:
    scan = cloth(0.002)
    x, rng = scan.states[:, 0], np.random.default_rng(1)
    featureless = np.abs(x - 0.085) > 0.015
    strain = np.where(featureless[:, None], rng.standard_normal(scan.strain.shape), scan.strain)
    assert registration_of(replace(scan, strain=strain)) > 0.0008


SHEET = Scene("sheet", (Axis("x", 0.0, 0.04), Axis("y", 0.0, 0.06)), (Phalanx("index", (0.0, 0.0), 4),))
SLOPE = 1e3 * np.array([[3.0, -1.0, 2.0, 0.5], [0.5, 2.0, -1.0, 3.0]])
"""V/m, of noise 1 V."""
LINES_Y = np.array([0.005, 0.010, 0.019, 0.024, 0.033, 0.038, 0.047, 0.052])
"""Each line has a mate 5 mm beside it and the next one 9 mm away."""


def sheet(
    shift: Callable[[int], tuple[float, float]], noisy: int | None = None, at: np.ndarray = LINES_Y
) -> SweepModel:
    """Lines along x over strains that are linear in the place, each with a ``shift`` of its places, m."""
    x, rng = np.arange(0.0, 0.0401, 0.0005), np.random.default_rng(0)
    lines = [np.column_stack([x, np.full_like(x, y)]) for y in at]
    strain = np.array([(line + shift(number)) @ SLOPE for number, line in enumerate(lines)])
    if noisy is not None:
        strain[noisy] += rng.standard_normal(strain[noisy].shape)
    sweep = np.repeat(np.arange(len(lines)), len(x))
    scan = Scan(np.concatenate(lines), np.concatenate(strain), sweep, ("x", "y"), ("index",), (4,))
    return SweepModel(whitened_scan(scan, SHEET), VarianceModel(1.0, 0.0, 0.0))


def test_the_shift_of_a_sweep_is_that_of_a_kalman_filter() -> None:
    model = sheet(lambda line: (0.001, -0.002) if line == 3 else (0.0, 0.0), noisy=3)
    line, without = model.scan.tracks.slices[3], np.arange(len(LINES_Y)) == 3
    shift, variance = register(model, line, without, 0.0017)
    # The mean of the lines 5 and 9 mm beside it has a variance of its own; 1.7 mm are one measurement.
    std = np.sqrt((1.0 + 0.54) * 0.0017 / 0.0005)
    exact = KalmanFilter(np.zeros(2), 0.02**2 * np.eye(2), LinearModel(SLOPE.T, std))
    for strain, place in zip(model.scan.strain[line], model.scan.tracks.positions[line], strict=True):
        exact.predict(np.zeros(2), SHEET.motion_std**2 * 0.0005)
        exact.update(strain - place @ SLOPE)
    np.testing.assert_allclose(exact.mean, [0.001, -0.002], atol=2e-4)
    np.testing.assert_allclose(shift[-1], exact.mean, atol=1e-4)
    np.testing.assert_allclose(variance[-1], exact.covariance.diagonal(), rtol=0.2)


def test_a_sweep_is_registered_without_the_others_on_its_line() -> None:
    """Pairs of passes over a line are alike, and shifted against the lines beside them."""
    at = np.repeat(np.arange(0.005, 0.06, 0.007), 2) + np.tile([0.0, 0.0001], 8)
    shifts = 0.003 * (-1.0) ** (np.arange(len(at)) // 2)
    along, across = registration_errors(sheet(lambda line: (shifts[line], 0.0), at=at), 0.0017)
    assert along > 0.003
    assert across < 0.0015


def test_the_registration_error_of_a_few_sweeps_is_near_its_prior() -> None:
    """And a sweep that is lost counts little."""
    std, sweeps = 0.001, 7
    shift = [np.tile([std * (-1.0) ** number, 0.0], (80, 1)) for number in range(sweeps)]
    shifts = [(each, np.full((80, 2), 1e-12)) for each in shift]
    along, across = registration_std(shifts, 2)
    prior, errors = 0.0015, 5.0
    expected = np.sqrt((errors * prior**2 + np.array([sweeps * std**2, 0.0])) / (errors + sweeps))
    np.testing.assert_allclose([along, across], expected, rtol=0.1)
    lost = registration_std([*shifts, (np.full((80, 2), 0.05), np.full((80, 2), 1e-12))], 2)
    assert lost[0] < 2.5 * along


def test_shifts_that_are_not_known_leave_the_prior() -> None:
    unknown = [(np.zeros((80, 2)), np.full((80, 2), 1.0))] * 7
    np.testing.assert_allclose(registration_std(unknown, 2), 0.0015, rtol=1e-3)


def test_a_sweep_is_localized_in_its_surroundings() -> None:
    """And up to a millimetre beyond the scan, but for yaw."""
    axes = (Axis("x", -1.0, 1.0), Axis("y", 0.0, 0.0301), Axis("yaw", -0.2, 0.2))
    scene = Scene("large", axes, (Phalanx("index", (0.0, 0.0, 0.0)),))
    near = surroundings(scene, np.array([[0.3, 0.02, -0.2], [0.4, 0.03, 0.2]]))
    np.testing.assert_allclose(near.lower, [0.25, 0.0, -0.2])
    np.testing.assert_allclose(near.upper, [0.45, 0.031, 0.2])
    part = surroundings(scene, np.array([[-2.0, 0.05, 0.0], [2.0, -0.05, 0.0]]))
    np.testing.assert_allclose([part.lower[:2], part.upper[:2]], [[-1.001, -0.001], [1.001, 0.0311]])
    turn = replace(scene, axes=(*axes[:2], Axis("yaw", -np.pi, np.pi)))
    assert surroundings(turn, np.zeros((1, 3))).upper[2] == np.pi


def test_a_single_sweep_gets_the_prior_of_the_registration_error() -> None:
    assert registration_of(cloth(0.0, 1)) == pytest.approx(0.0015)
