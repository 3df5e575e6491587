"""A region is believed where what lies outside it proves featureless on held-out sweeps."""

import dataclasses

import numpy as np

from tactile_localizer.core.region_confidence import with_region
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.resources import resource_path
from tactile_localizer.sim import simulate_scan


def test_a_region_that_the_scene_gives_is_kept() -> None:
    scene = load_scene(resource_path("config/scenes/bump.yaml"))
    scan = simulate_scan("bump", seed=3).to_scan()
    assert with_region(scan, scene) is scene


def test_what_proves_featureless_outside_a_proposal_makes_it_the_region() -> None:
    scene = load_scene(resource_path("config/scenes/bump.yaml"))
    scan = simulate_scan("bump", seed=3).to_scan()
    assert with_region(scan, dataclasses.replace(scene, feature=None)).feature is not None


def test_material_that_is_featured_everywhere_gets_no_region() -> None:
    """Position predicts the strain outside any box that could be drawn: a weave with one coarser patch."""
    rng = np.random.default_rng(1)
    scene = load_scene(resource_path("config/scenes/linen.yaml"))
    x = np.tile(np.linspace(0.0, 0.6, 1500), 3)
    weave = np.sin(x[:, None] * rng.uniform(60, 200, 16) + rng.uniform(0, 6, 16))
    weave[(x > 0.2) & (x < 0.25)] *= 12.0
    strain = weave + 0.02 * rng.standard_normal(weave.shape)
    scan = Scan(x[:, None], strain, np.repeat(np.arange(3), 1500), ("x",), scene.phalanx_names)
    assert with_region(scan, scene).feature is None
