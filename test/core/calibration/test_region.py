"""The feature's region is found where strain leaves what most of the material feels like."""

import dataclasses

import numpy as np
import pytest

from tactile_localizer.core.region import featureless_cluster, propose_region
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.resources import resource_path
from tactile_localizer.scene import Axis, Phalanx, Scene
from tactile_localizer.sim import simulate_scan


@pytest.mark.parametrize("feature", ["bump", "snap", "grommet"])
def test_the_proposal_covers_what_the_simulation_touches(feature: str) -> None:
    scene = load_scene(resource_path(f"config/scenes/{feature}.yaml"))
    proposal = propose_region(simulate_scan(feature, seed=3).to_scan(), scene)
    assert proposal.region is not None
    assert scene.feature is not None
    np.testing.assert_allclose(proposal.region.lower, scene.feature.lower, atol=0.008)
    np.testing.assert_allclose(proposal.region.upper, scene.feature.upper, atol=0.008)


def test_material_without_a_feature_has_no_region() -> None:
    scene = load_scene(resource_path("config/scenes/bump.yaml"))
    assert propose_region(simulate_scan("none", seed=3).to_scan(), scene).region is None


@pytest.mark.parametrize("value", [0.0, 0.5, 1e9, 1e-12])
def test_gauges_that_all_feel_the_same_have_no_region(value: float) -> None:
    scene = load_scene(resource_path("config/scenes/bump.yaml"))
    scan = simulate_scan("bump", seed=3).to_scan()
    strain = np.full_like(scan.strain, value)
    flat = Scan(scan.states, strain, scan.sweep, scan.axes, scan.phalanges)
    assert propose_region(flat, scene).region is None
    strain[:, 4:] = scan.strain[:, 4:]  # only some are dead
    propose_region(Scan(scan.states, strain, scan.sweep, scan.axes, scan.phalanges), scene)


def test_the_cluster_is_not_moved_by_a_minority_that_is_far_away() -> None:
    rng = np.random.default_rng(0)
    samples = rng.standard_normal((1000, 8))
    samples[:400] += 50.0
    cluster = featureless_cluster(samples)
    np.testing.assert_allclose(cluster.mean, 0.0, atol=0.5)
    assert cluster.squared_distance(samples[:400]).min() > 100.0


def test_sweeps_that_each_have_an_offset_of_their_own_do_not_hide_the_region() -> None:
    scene = load_scene(resource_path("config/scenes/bump.yaml"))
    scan = simulate_scan("bump", seed=3).to_scan()
    offsets = 0.3 * scan.strain.std(axis=0) * np.random.default_rng(2).standard_normal((500, 16))
    shifted = dataclasses.replace(scan, strain=scan.strain + offsets[scan.sweep])
    plain, found = (propose_region(each, scene).region for each in (scan, shifted))
    np.testing.assert_allclose(found.lower, plain.lower, atol=0.008)
    np.testing.assert_allclose(found.upper, plain.upper, atol=0.008)


def test_a_sweep_that_lies_on_the_feature_all_along_counts_as_touched() -> None:
    rng = np.random.default_rng(3)
    line = np.stack([np.linspace(0.0, 0.05, 200), np.zeros(200)], axis=1)
    states = np.concatenate([line + np.array([0.0, 0.005 * number]) for number in range(9)])
    sweep = np.repeat(np.arange(9), 200)
    strain = 0.02 * rng.standard_normal((1800, 8)) + 0.05 * rng.standard_normal((9, 8))[sweep]
    strain[np.isin(sweep, (4, 5))] += 2.0
    axes = (Axis("x", 0.0, 0.05, 0.002), Axis("y", 0.0, 0.04, 0.002))
    scene = Scene("ridge", axes, (Phalanx("index", (0.0, 0.0)),))
    region = propose_region(Scan(states, strain, sweep, ("x", "y"), ("index",)), scene).region
    assert region.lower[1] < 0.020 < 0.025 < region.upper[1]
