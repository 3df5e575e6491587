"""How badly a map explains its own held-out sweeps is where unknown material begins."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from support.models import FlatModel
from support.scans import scan, scene

from tactile_localizer.core.fit import HeldOutFit, held_out_fit, held_out_log_densities
from tactile_localizer.core.likelihood.base import MeasurementModel
from tactile_localizer.core.likelihood.sum_of_gaussians import SumOfGaussians
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Region, Scene

NOWHERE = Region((1.0, 1.0), (2.0, 2.0))


def sum_of_gaussians(of: Scene, made: Scan) -> MeasurementModel:
    return SumOfGaussians(made, of, 0.003, 0.05)


def test_each_pair_is_explained_by_a_map_without_its_sweep() -> None:
    of = scene()
    made = scan(np.random.default_rng(1), of)
    used = []

    def build(part: Scan) -> MeasurementModel:
        used.append(set(np.unique(part.sweep)))
        return sum_of_gaussians(of, part)

    tried, together, alone = held_out_log_densities(made, of, np.arange(len(made)), build)
    left_out = [next(iter(set(np.unique(made.sweep)) - sweeps)) for sweeps in used]
    assert set(made.sweep[tried]) == set(left_out)
    assert together.shape == (len(tried),)
    assert alone.shape == (len(tried), 2)
    assert (np.diff(tried) > 0).all()


def test_all_but_one_in_twenty_reach_the_limit() -> None:
    of = scene()
    made = scan(np.random.default_rng(1), of)
    _, together, _ = held_out_log_densities(
        made, of, np.arange(len(made)), lambda part: sum_of_gaussians(of, part)
    )
    fit = held_out_fit(made, of, lambda part: sum_of_gaussians(of, part))
    assert np.mean(together >= fit.of(np.ones(2, bool))) == pytest.approx(0.95, abs=0.01)


def test_a_hand_of_one_phalanx_has_one_limit() -> None:
    of = scene(2, phalanges=1)
    made = scan(np.random.default_rng(1), of)
    fit = held_out_fit(made, of, lambda part: sum_of_gaussians(of, part))
    assert fit.alone.tolist() == [fit.together]


def test_some_phalanges_have_their_share_of_the_limit() -> None:
    fit = HeldOutFit(-30.0, np.array([-8.0, -10.0, -12.0]))
    assert fit.of(np.array([True, True, True])) == -30.0
    assert fit.of(np.array([False, True, False])) == -10.0
    assert fit.of(np.array([True, True, False])) == pytest.approx(-20.0)


def test_where_nothing_can_be_held_out_there_is_no_limit() -> None:
    of = dataclasses.replace(scene(), feature=NOWHERE)
    made = scan(np.random.default_rng(1), of)
    fit = held_out_fit(made, of, lambda part: FlatModel())
    assert [fit.of(np.array(present)) for present in ([True, True], [True, False])] == [-np.inf, -np.inf]
