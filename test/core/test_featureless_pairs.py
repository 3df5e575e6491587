"""What is known to be featureless leaves out glitches and fringes, but never a part of the material."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_localizer.core.featureless_pairs import featureless_pairs, ordinary
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Axis, Phalanx, Region, Scene

SCENE = Scene("strip", (Axis("x", 0.0, 0.1, 0.002),), (Phalanx("index", (0.0,)),), Region((0.04,), (0.06,)))


def strip(sweeps: int = 5, pairs: int = 400) -> Scan:
    """Featureless but for the middle fifth, each sweep with an offset many times its noise."""
    rng = np.random.default_rng(4)
    x, sweep = np.tile(np.linspace(0.0, 0.1, pairs), sweeps), np.repeat(np.arange(sweeps), pairs)
    strain = 0.01 * rng.standard_normal((len(x), 8)) + rng.standard_normal((sweeps, 8))[sweep]
    strain[(x > 0.045) & (x < 0.055)] += 1.0
    return Scan(x[:, None], strain, sweep, ("x",), ("index",))


def test_pairs_off_the_region_are_featureless_whatever_their_sweeps_offset() -> None:
    scan = strip()
    off = ~SCENE.on_feature(scan.states)
    assert (featureless_pairs(scan, SCENE) & off).sum() > 0.99 * off.sum()
    assert not featureless_pairs(scan, SCENE)[~off].any()


@pytest.mark.parametrize("size", [0.05, 5.0, 1e6])
def test_glitches_are_not_featureless(size) -> None:
    scan = strip()
    glitches = np.arange(3, len(scan), 60)
    strain = scan.strain.copy()
    strain[glitches] += size * np.random.default_rng(5).standard_normal((len(glitches), 8))
    known = featureless_pairs(Scan(scan.states, strain, scan.sweep, scan.axes, scan.phalanges), SCENE)
    assert known[glitches].mean() < 0.05
    assert known.sum() > 0.97 * featureless_pairs(scan, SCENE).sum()


def test_without_a_region_no_pair_is_known() -> None:
    assert not featureless_pairs(strip(), Scene("strip", SCENE.axes, SCENE.phalanges)).any()


@given(share=st.floats(0.1, 0.5), away=st.floats(0.0, 1e6), seed=st.integers(0, 2**32 - 1))
def test_a_part_of_the_material_that_feels_different_is_kept(share, away, seed) -> None:
    samples = np.random.default_rng(seed).standard_normal((500, 8))
    samples[: int(share * 500)] += away
    assert ordinary(samples).mean() > 0.97


@pytest.mark.parametrize("samples", [np.zeros((50, 8)), np.ones((1, 8)), np.full((3, 16), 1e9)])
def test_samples_that_do_not_vary_are_all_ordinary(samples) -> None:
    assert ordinary(samples).all()
