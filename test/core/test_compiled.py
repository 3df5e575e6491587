"""The compiled twins give what numpy gives, on random input and at the extremes."""

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.scans import scene

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core import compiled
from tactile_localizer.core.filters.grid_motion import MovedCells
from tactile_localizer.core.filters.living import Living
from tactile_localizer.core.geometry.anchors import Anchors
from tactile_localizer.core.hypotheses.convergence import Ellipsoid
from tactile_localizer.core.likelihood.ancestry import Ancestry
from tactile_localizer.core.likelihood.drift import Drift, Trend
from tactile_localizer.core.likelihood.gain import Gain
from tactile_localizer.core.likelihood.on_map import Felt, MapLikelihood, Places
from tactile_localizer.core.likelihood.other_material import OtherMaterial
from tactile_localizer.core.likelihood.scatter import Scatter
from tactile_localizer.core.likelihood.strain_map import StrainMap
from tactile_localizer.core.likelihood.white_noise import SweepNoise, WhiteNoise
from tactile_localizer.core.weights import bayes
from tactile_localizer.core.weights import moments as mean_and_covariance

SEEDS = st.integers(0, 2**32 - 1)
LAYOUTS = st.sampled_from([ChannelLayout(counts) for counts in ((8, 8), (3, 5, 1), (1,), (40, 2), (8,) * 14)])
SIZES = st.sampled_from([1e-3, 1.0, 100.0, 1e6, 1e9])
"""Of whitened strains; larger ones are clipped."""
LEVELS = st.sampled_from([0.0, 1.0, 1e9])
"""Variances of a level: known, open, and at the first strain."""


def test_the_module_is_built() -> None:
    """Where there is a compiler, as in the workspace that runs these tests."""
    assert compiled.MODULE is not None


def both(monkeypatch: pytest.MonkeyPatch, call: Callable[[], Any]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Results of a call, by the compiled module and by numpy."""
    by_module = call()
    with monkeypatch.context() as patched:
        patched.setattr(compiled, "MODULE", None)
        by_numpy = call()
    flat = [list(flattened(each)) for each in (by_module, by_numpy)]
    return zip(*flat, strict=True)


def flattened(found: Any) -> Iterator[np.ndarray]:
    """The arrays in nested tuples."""
    if isinstance(found, tuple):
        for each in found:
            yield from flattened(each)
    else:
        yield np.asarray(found)


def random_map(rng: np.random.Generator, layout: ChannelLayout, *shape: int, size: float = 1.0) -> StrainMap:
    """Four components a node, of which some are alike, with signals of a size."""
    nodes, axes = int(np.prod(shape)), len(shape)
    mean = size * rng.standard_normal((nodes, 4, layout.size)) * rng.integers(0, 2, (nodes, 4, 1))
    variance = rng.uniform(0.1, 10.0, (nodes, 4, layout.phalanges))
    prior = np.log(rng.dirichlet(np.ones(4), nodes))
    tables = (table.astype(np.float32) for table in (mean, variance, prior))
    origin, step = rng.uniform(-1.0, 1.0, axes), rng.uniform(1e-4, 1e-2, axes)
    return StrainMap(origin, step, shape, *tables, 0.1, np.zeros((axes, layout.size)))


@given(seed=SEEDS, layout=LAYOUTS, axes=st.integers(1, 3))
def test_nodes_are_the_nearest_also_outside_and_halfway(seed: int, layout: ChannelLayout, axes: int) -> None:
    rng = np.random.default_rng(seed)
    strain_map = random_map(rng, layout, *rng.integers(1, 6, axes).tolist())
    model = MapLikelihood(strain_map, layout)
    steps = rng.integers(-6, 14, (50, axes)) / 2.0 + rng.choice([0.0, 0.2, 1e9], (50, axes))
    with pytest.MonkeyPatch.context() as patch:
        for one, other in both(patch, lambda: model.expected(strain_map.origin + steps * strain_map.step)):
            np.testing.assert_array_equal(one, other)


@given(seed=SEEDS, layout=LAYOUTS, size=SIZES, signal=SIZES, level=LEVELS, flags=st.integers(0, 7))
def test_likelihoods_on_the_map_are_those_of_numpy(
    seed: int, layout: ChannelLayout, size: float, signal: float, level: float, flags: int
) -> None:
    """With and without other noise than in the scan, of phalanges or of all together; some do not count."""
    rng = np.random.default_rng(seed)
    model = MapLikelihood(random_map(rng, layout, 9, size=signal), layout)
    states, places, phalanges = int(rng.integers(0, 120)), 130, layout.phalanges
    within = np.equal.outer(layout.phalanx, layout.phalanx) if flags & 2 else True
    triangle = rng.uniform(0.0, 0.2, (layout.size,) * 2) * within * np.tri(layout.size).T
    transform = (np.eye(layout.size) + triangle).astype(np.float32) if flags & 1 else None
    used = rng.integers(0, 2, phalanges).astype(bool) if flags & 4 else np.ones(phalanges, dtype=bool)
    nodes, of_map = model.expected(rng.uniform(-1.0, 1.0, (places, 1)))
    gain = Gain(rng.uniform(0.05, 1.0, (2, phalanges, places)).astype(np.float32))
    strain = (of_map[0] + size * rng.standard_normal(layout.size)).astype(np.float32)
    felt = Felt(strain, transform, np.full(phalanges, level, dtype=np.float32), used)
    names = ("states", "anchors", "gain")
    with pytest.MonkeyPatch.context() as patch, np.errstate(over="ignore"):
        found = both(patch, lambda: model.of(felt, Places(nodes, states, of_map, gain), 0.4))
        for name, (one, other) in zip(names, found, strict=True):
            assert one.dtype == other.dtype, name
            assert np.isfinite(one).all(), name
            assert name != "gain" or (one[1] >= 0.0).all(), name
            if signal <= 100.0:  # of larger ones float32 leaves no difference from the strain
                rough = 1e-4 + 2e-6 * signal**2  # the residual is the difference of squared signals
                largest = np.abs(other).max(initial=1.0)
                np.testing.assert_allclose(one, other, rtol=rough, atol=rough * largest, err_msg=name)


@given(seed=SEEDS, layout=LAYOUTS, size=SIZES, flags=st.integers(0, 3))
def test_moments_of_residuals_are_those_of_numpy(
    seed: int, layout: ChannelLayout, size: float, flags: int
) -> None:
    """Of states that fit and others, with and without other noise than in the scan, and of outliers."""
    rng = np.random.default_rng(seed)
    model, phalanges = MapLikelihood(random_map(rng, layout, 9), layout), layout.phalanges
    states, places = int(rng.integers(1, 160)), 170
    transform = np.triu(rng.uniform(0.5, 1.0, (layout.size,) * 2)).astype(np.float32) if flags & 1 else None
    nodes, of_map = model.expected(rng.uniform(-1.0, 1.0, (places, 1)))
    gain = Gain(rng.uniform(0.05, 1.0, (2, phalanges, places)).astype(np.float32))
    strain = (size * rng.standard_normal(layout.size)).astype(np.float32)
    felt = Felt(strain, transform, np.ones(phalanges, dtype=np.float32), np.ones(phalanges, dtype=bool))
    weights = rng.dirichlet(np.ones(states)) ** (8.0 if flags & 2 else 1.0)
    with pytest.MonkeyPatch.context() as patch:
        ((one, other),) = both(
            patch, lambda: (model.moments(felt, Places(nodes, states, of_map, gain), weights),)
        )
    assert np.isfinite(one).all()
    np.testing.assert_allclose(one, other, rtol=1e-3, atol=1e-4 * np.abs(other).max())


@given(seed=SEEDS, channels=st.integers(1, 20), noisier=st.sampled_from([1.0, 9.0]))
def test_the_noise_of_a_sweep_is_that_of_numpy(seed: int, channels: int, noisier: float) -> None:
    """With spikes, after gaps, of channels that are absent for a while, and of much noise."""
    rng, flat = np.random.default_rng(seed), np.ones(1)
    strains = noisier * rng.standard_normal((60, channels))
    strains[rng.random(strains.shape) < 0.01] += 100.0
    present = rng.random((60, channels)) < np.where(np.arange(60) < 40, 1.0, 0.9)[:, None]
    travels = rng.choice([0.0005, 0.05], 60, p=[0.95, 0.05])
    scan = WhiteNoise(0.0005 * flat, np.full((1, channels), 1.2))

    def taken_in() -> tuple[Any, ...]:
        sweep, found = SweepNoise(scan), []
        for strain, here, travel in zip(strains, present, travels, strict=True):
            found.append((sweep.observe(strain, here, travel), sweep.excess(0.001), sweep.spikes))
        return tuple(found)

    with pytest.MonkeyPatch.context() as patch:
        for one, other in both(patch, taken_in):
            np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12)


@given(seed=SEEDS, layout=LAYOUTS, share=st.floats(0.0, 1.0))
def test_moments_are_averaged_as_by_numpy(seed: int, layout: ChannelLayout, share: float) -> None:
    """Blocks of the phalanges, of which some do not count."""
    rng, within = np.random.default_rng(seed), np.equal.outer(layout.phalanx, layout.phalanx)
    before, moments = (each @ each.T * within for each in rng.standard_normal((2, layout.size, layout.size)))
    scatter, used = Scatter.of(layout, before, 1.0), rng.integers(0, 2, layout.phalanges).astype(bool)
    with pytest.MonkeyPatch.context() as patch:
        for one, other in both(patch, lambda: tuple(scatter.after(moments, used, share, 2.0)[1:])):
            np.testing.assert_allclose(one, other, rtol=1e-9)


@given(seed=SEEDS, axes=st.integers(1, 3), states=st.integers(1, 50), wraps=st.integers(0, 7))
def test_means_and_covariances_are_those_of_numpy(seed: int, axes: int, states: int, wraps: int) -> None:
    rng, turns = np.random.default_rng(seed), np.array([wraps & 1, wraps & 2, wraps & 4], dtype=bool)[:axes]
    places, weights = rng.uniform(-9.0, 9.0, (states, axes)), rng.dirichlet(np.ones(states))
    with pytest.MonkeyPatch.context() as patch:
        for one, other in both(patch, lambda: mean_and_covariance(places, weights, turns)):
            np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)


def test_a_component_that_is_likelier_than_any_number_leaves_finite_likelihoods() -> None:
    """The first component of 40 channels is 1e8 widths away, another one is felt: a thousand nats."""
    layout, mean = ChannelLayout((40,)), np.zeros((1, 2, 40), dtype=np.float32)
    mean[:, 0] = 1e8
    tables = mean, np.ones((1, 2, 1), dtype=np.float32), np.log(np.full((1, 2), 0.5, dtype=np.float32))
    one = np.ones(1)
    model = MapLikelihood(StrainMap(one, one, (1,), *tables, 0.1, np.zeros((1, 40))), layout)
    zero, used = np.zeros(40, dtype=np.float32), np.ones(1, dtype=bool)
    felt = Felt(zero, None, zero[:1], used)
    gain = Gain(np.array([[[1.0]], [[0.0]]], dtype=np.float32))
    nodes, of_map = model.expected(one[:, None])
    with pytest.MonkeyPatch.context() as patch:
        for by_module, by_numpy in both(patch, lambda: model.of(felt, Places(nodes, 1, of_map, gain), 1.0)):
            assert np.isfinite(by_module).all()
            np.testing.assert_allclose(by_module, by_numpy, rtol=1e-5)


@given(
    seed=SEEDS,
    channels=st.integers(1, 24),
    places=st.integers(0, 9),
    memory=st.sampled_from([0.02, np.inf]),
    largest=st.sampled_from([100.0, np.inf]),
    prior=st.sampled_from([0.0, 1.0, np.inf]),
    size=SIZES,
)
def test_drifts_are_followed_as_by_numpy(
    seed: int, channels: int, places: int, memory: float, largest: float, prior: float, size: float
) -> None:
    """From the first strain on, by exponents of all channels or of each."""
    rng = np.random.default_rng(seed)
    drift = Drift(memory, 1.3, np.full(channels, prior), largest)
    strains = size * rng.standard_normal((5, channels))
    expected = rng.standard_normal((5, places, channels)).astype(np.float32)

    def followed() -> list[Any]:
        found, trend = [], drift.start(places)
        for number, (strain, of_map) in enumerate(zip(strains, expected, strict=True)):
            exponent = 0.3 if number % 2 else np.linspace(0.1, 1.0, channels)
            innovation, trend = drift.update(trend, strain, of_map, 0.01 * number, exponent)
            level = Trend(np.broadcast_to(trend.measurements, channels), *trend[1:])
            found.append((*innovation[:3], *level))
        return found

    with pytest.MonkeyPatch.context() as patch:
        for one, other in both(patch, lambda: tuple(followed())):
            np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-5 * np.abs(other).max(initial=1.0))


@given(seed=SEEDS, shape=st.lists(st.integers(1, 9), min_size=1, max_size=3), flags=st.integers(0, 7))
def test_cells_are_moved_as_by_numpy(seed: int, shape: list[int], flags: int) -> None:
    """By some cells along some axes, or past the end, around turns, and spread along some."""
    rng, axes = np.random.default_rng(seed), len(shape)
    belief = rng.dirichlet(np.ones(math.prod(shape))).reshape(shape)
    numbers = rng.permutation(belief.size).reshape(shape)
    shift = (rng.integers(-4, 5, axes) * rng.integers(0, 2, axes) * (flags & 1)).tolist()
    variance = (rng.uniform(0.0, 0.6, axes) * rng.integers(0, 2, axes) * (flags >> 1 & 1)).tolist()
    wraps = rng.integers(0, 2, axes).astype(bool) & bool(flags & 4)
    with pytest.MonkeyPatch.context() as patch:
        for one, other in both(patch, lambda: MovedCells.of(belief, numbers, shift, variance, wraps)):
            np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-15)


@given(seed=SEEDS, axes=st.integers(1, 3), count=st.integers(1, 40))
def test_living_cells_are_those_of_numpy(seed: int, axes: int, count: int) -> None:
    """Of a belief with weight in some cells, of which some were living before, and some was taken in."""
    rng = np.random.default_rng(seed)
    belief = rng.dirichlet(np.ones(count)) * rng.integers(0, 2, count)
    belief[rng.integers(count)] = 0.5
    numbers = np.where(rng.integers(0, 2, count), rng.permutation(count), -1)
    centres, offset = rng.standard_normal((axes, count)), rng.standard_normal(axes)
    given_cells = belief, belief * rng.random(count), numbers, centres, offset, 1e-3
    with pytest.MonkeyPatch.context() as patch:
        for one, other in both(patch, lambda: Living.of(*given_cells)):
            assert one.dtype == other.dtype
            np.testing.assert_allclose(one, other, rtol=1e-12)


@given(seed=SEEDS, axes=st.integers(1, 3), size=st.sampled_from([0.0, 1e-3, 1.0, 1e3]))
def test_anchors_move_as_by_numpy(seed: int, axes: int, size: float) -> None:
    """Over several bounds as well; at the last axis of three they turn."""
    displacements = size * np.random.default_rng(seed).standard_normal((5, axes))

    def moved() -> tuple[Any, ...]:
        anchors, found = Anchors(scene(axes, full_turn=axes == 3)), []
        for each in displacements:
            left, values = anchors.move(each), np.arange(float(len(anchors)))
            found.append((left, anchors.states, anchors.far_from(anchors.states[3].copy(), 0.01, values)))
        return tuple(found)

    with pytest.MonkeyPatch.context() as patch:
        for one, other in both(patch, moved):
            assert one.dtype == other.dtype
            np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12)


@given(seed=SEEDS, kinds=st.integers(1, 4), channels=st.integers(1, 20), size=SIZES)
def test_trajectories_are_followed_as_by_numpy(seed: int, kinds: int, channels: int, size: float) -> None:
    """Of states, most of which are continued as their neighbours are, and of anchors."""
    rng = np.random.default_rng(seed)
    (before, states, anchors), mixed = rng.integers(1, 9, 3), rng.integers(0, 2, 2)
    values = size * rng.standard_normal((kinds, before + anchors, channels)).astype(np.float32)
    ancestors = rng.integers(0, before, states) if mixed[0] else np.arange(states) % before
    continued = np.where(rng.random(states) < 0.5 * mixed[1], rng.random(states), 1.0)
    ancestry = Ancestry(ancestors, continued, rng.random(anchors), rng.dirichlet(np.ones(before)))
    for known in (values, values[..., 0].copy()):
        with pytest.MonkeyPatch.context() as patch:
            for one, other in both(patch, lambda known=known: ancestry.followed(known)):
                assert one.shape == other.shape
                np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-6 * size)


@pytest.mark.parametrize("ancestor", [-1, 3])
def test_an_ancestor_that_there_is_not_is_refused(ancestor: int) -> None:
    ancestry = Ancestry(np.array([ancestor]), np.ones(1), np.zeros(0), np.ones(3))
    with pytest.raises(ValueError, match=f"expected numbers below 3, got {ancestor}"):
        ancestry.followed(np.zeros((1, 3, 1), dtype=np.float32))


def test_values_of_other_than_the_states_and_anchors_are_refused() -> None:
    ancestry = Ancestry(np.array([0]), np.zeros(1), np.zeros(2), np.ones(2))
    with pytest.raises(ValueError, match="VALUES: expected 4 values"):
        ancestry.followed(np.zeros((1, 3, 1), dtype=np.float32))


@given(seed=SEEDS, layout=LAYOUTS, size=SIZES, level=LEVELS)
def test_other_material_is_as_likely_as_by_numpy(
    seed: int, layout: ChannelLayout, size: float, level: float
) -> None:
    rng = np.random.default_rng(seed)
    material = OtherMaterial(layout, np.diag(rng.uniform(0.0, 40.0, layout.size)), np.full(1, 1.3))
    weights = rng.dirichlet(np.ones(len(material.start())), layout.phalanges).T
    innovation, levels = size * rng.standard_normal(layout.size), np.full(layout.phalanges, level)
    used = rng.integers(0, 2, layout.phalanges).astype(bool)
    with pytest.MonkeyPatch.context() as patch:
        found = both(patch, lambda: material.update(weights, innovation, levels, used, 0.0005, 0.3))
        for one, other in found:
            np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12)


@given(seed=SEEDS, states=st.integers(1, 90), size=st.sampled_from([1.0, 1e3, 1e15]), none=st.integers(0, 3))
def test_weights_are_those_of_numpy(seed: int, states: int, size: float, none: int) -> None:
    """Also where a state has no weight, or a measurement is impossible, at some or at all of them."""
    rng = np.random.default_rng(seed)
    prior, likelihood = rng.dirichlet(np.ones(states)), size * rng.standard_normal(states)
    if none & 1:
        likelihood[rng.random(states) < rng.choice([0.5, 1.0])] = -np.inf
    if none & 2 and states > 1:
        prior[rng.integers(states)] = 0.0
    with pytest.MonkeyPatch.context() as patch:
        for one, other in both(patch, lambda: bayes(prior, likelihood)):
            np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-300)


@given(seed=SEEDS, axes=st.integers(1, 3), spread=st.sampled_from([0.0, 1e-8, 1e-6, 1e-2]))
def test_the_probability_near_a_place_is_that_of_numpy(seed: int, axes: int, spread: float) -> None:
    rng = np.random.default_rng(seed)
    ellipsoid = Ellipsoid(np.full(axes, 0.0075), rng.uniform(0.0, 1.0, axes) * spread)
    away, weights = rng.uniform(-0.03, 0.03, (60, axes)), rng.dirichlet(np.ones(60))
    with pytest.MonkeyPatch.context() as patch:
        ((one, other),) = both(patch, lambda: ellipsoid.probability(away, weights))
    assert one == pytest.approx(other, rel=1e-9, abs=1e-12)


def test_an_array_of_another_type_is_refused() -> None:
    drift = Drift(0.02, 1.0, np.ones(3))
    with pytest.raises(ValueError, match="expected"):
        drift.update(drift.start(4), np.zeros(3), np.zeros((4, 3)), 0.001, 1.0)
