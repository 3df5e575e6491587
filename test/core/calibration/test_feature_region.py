"""The proposed feature region is the box around places with a reproducible signal."""

import dataclasses
import importlib
from pathlib import Path

import numpy as np
import pytest

from tactile_localizer.core.calibration.feature_region import propose_region
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.resources import resource_path
from tactile_localizer.sim import simulate_scan

ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize("feature", ["bump", "snap", "grommet"])
def test_the_proposal_agrees_with_the_simulation(feature: str) -> None:
    scene = load_scene(resource_path(f"config/scenes/{feature}.yaml"))
    proposal = propose_region(simulate_scan(feature, seed=3).to_scan(), scene)
    assert proposal.region is not None
    assert scene.feature is not None
    np.testing.assert_allclose(proposal.region.lower, scene.feature.lower, atol=0.008)
    np.testing.assert_allclose(proposal.region.upper, scene.feature.upper, atol=0.008)


def test_the_region_of_the_scene_is_ignored() -> None:
    scene = load_scene(resource_path("config/scenes/bump.yaml"))
    scan = simulate_scan("bump", seed=3).to_scan()
    without = dataclasses.replace(scene, feature=None)
    assert propose_region(scan, scene).region == propose_region(scan, without).region


@pytest.mark.parametrize("seed", [3, 5])
def test_material_without_a_feature_has_no_region(seed: int) -> None:
    scene = load_scene(resource_path("config/scenes/bump.yaml"))
    assert propose_region(simulate_scan("none", seed=seed).to_scan(), scene).region is None


@pytest.mark.parametrize("value", [0.0, 0.5, 1e9, 1e-12])
def test_constant_gauges_have_no_region(value: float) -> None:
    scene = load_scene(resource_path("config/scenes/bump.yaml"))
    scan = simulate_scan("bump", seed=3).to_scan()
    strain = np.full_like(scan.strain, value)
    flat = Scan(scan.states, strain, scan.sweep, scan.axes, scan.phalanges)
    assert propose_region(flat, scene).region is None
    strain[:, 4:] = scan.strain[:, 4:]  # only some are dead
    propose_region(Scan(scan.states, strain, scan.sweep, scan.axes, scan.phalanges), scene)


def test_offsets_of_the_sweeps_do_not_hide_the_region() -> None:
    scene = load_scene(resource_path("config/scenes/bump.yaml"))
    scan = simulate_scan("bump", seed=3).to_scan()
    offsets = 0.3 * scan.strain.std(axis=0) * np.random.default_rng(2).standard_normal((500, 16))
    shifted = dataclasses.replace(scan, strain=scan.strain + offsets[scan.sweep])
    plain, found = (propose_region(each, scene).region for each in (scan, shifted))
    assert plain is not None
    assert found is not None
    np.testing.assert_allclose(found.lower, plain.lower, atol=0.008)
    np.testing.assert_allclose(found.upper, plain.upper, atol=0.008)


def test_fabric_has_no_region(data_dir: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    recordings = importlib.import_module("fabric_recordings")
    maps = [c for c in recordings.find_conditions(data_dir / "fabric_slide") if c.mapped]
    for condition in maps:
        fabric = recordings.load_map(condition)
        assert propose_region(fabric.scan, fabric.scene).region is None, condition.name
    assert len(maps) >= 8
