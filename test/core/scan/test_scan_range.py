"""Strains and positions out of the range of a scan are reported."""

import dataclasses

import numpy as np
import pytest
from support.sweeps import unseen_sweep

from tactile_localizer.core.scan.range import ScanRange, describe_misfit, describe_quiet
from tactile_localizer.scene import Axis
from tactile_localizer.sim import shipped_scene, simulate_scan

ALL = np.ones(2, dtype=bool)


@pytest.fixture(scope="module")
def known() -> ScanRange:
    return ScanRange.of(simulate_scan("bump", seed=1), shipped_scene("bump"))


def test_a_new_sweep_is_within_the_range(known: ScanRange) -> None:
    sweep = unseen_sweep()
    assert not known.strains_outside(sweep.strain, ALL).any()
    assert not known.positions_outside(sweep.position, sweep.position[0]).any()
    assert describe_misfit(0.0, 0.0) == ""


def test_strain_that_varies_less_than_noise_is_in_another_unit(known: ScanRange) -> None:
    noise = np.random.default_rng(2).normal(scale=known.noise, size=(400, 16))
    for strain in (unseen_sweep().strain, noise):  # a blank sheet has noise, too
        assert (known.spread(strain) > 0.9).all()
        assert (known.spread(1e-3 * strain) < 0.2).all()
        strain[:, :8] *= 1e-3
        spread = np.stack([known.spread(strain)] * 3)
        assert describe_quiet(("index", "middle"), spread).startswith("strain of index varies by only 0.0")
    assert np.isinf(known.spread(np.full((400, 16), np.nan))).all()
    assert describe_quiet(("index", "middle"), np.full((3, 2), np.inf)) == ""


def test_an_absent_phalanx_does_not_count(known: ScanRange) -> None:
    strain = unseen_sweep().strain
    strain[:, :8] = 5.0
    assert known.strains_outside(strain, ALL).all()
    assert not known.strains_outside(strain, np.array([False, True])).any()
    strain[:, :8] = np.nan
    assert not known.strains_outside(strain, np.array([False, True])).any()


def test_a_full_turn_axis_has_no_range() -> None:
    axes = Axis("x", 0.0, 0.05), Axis("yaw", -np.pi, np.pi)
    scene = dataclasses.replace(shipped_scene("bump"), axes=axes, feature=None)
    known = ScanRange.of(simulate_scan("bump", seed=1), scene)
    assert not known.positions_outside(np.array([0.01, 40.0]), np.zeros(2))
    assert known.positions_outside(np.array([0.06, 0.0]), np.zeros(2))


def test_the_warning_names_the_usual_causes() -> None:
    assert describe_misfit(0.5, 0.05).startswith("50% of the strains are outside the range of the scan")
    both = describe_misfit(0.5, 1.0)
    assert "unit, tare" in both
    assert "100% of the positions" in both
