"""The sum-of-Gaussians model (the paper's Eq. 4), conditional and joint."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import logsumexp
from support import densities
from support.scans import scan, scene, strain_at

from tactile_localizer.core.likelihood.sum_of_gaussians import SumOfGaussians
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import MeasurementError, ParameterError, SceneError
from tactile_localizer.scene import Axis, Phalanx, Scene

WIDTHS = (np.array([0.003, 0.004, 0.15]), 0.05)


def setting(dimension=2, phalanges=2, pairs=150):
    of = scene(dimension, phalanges)
    return of, scan(np.random.default_rng(1), of, pairs)


@pytest.mark.parametrize("evaluation", ["exact", "truncated", "field"])
@pytest.mark.parametrize("conditional", [True, False])
@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_the_density_is_the_sum_over_pairs(evaluation, conditional, dimension):
    of, made = setting(dimension)
    position_std = WIDTHS[0][:dimension]
    model = SumOfGaussians(made, of, position_std, WIDTHS[1], conditional, evaluation)
    rng = np.random.default_rng(2)
    states = of.lower + rng.random((12, dimension)) * (of.upper - of.lower)
    measured = strain_at(states[:1])[0] + 0.02 * rng.standard_normal(16)
    expected = [
        densities.sum_of_gaussians(
            made.states, made.strain, position_std, WIDTHS[1], state, measured, conditional
        )
        for state in states
    ]
    tolerance = 1e-6 if evaluation == "exact" else 0.02
    np.testing.assert_allclose(model.log_likelihood(states, measured), expected, atol=tolerance)


@pytest.mark.parametrize("place", [(0.02, 0.03), (0.0, 0.0), (-1.0, 5.0)])
def test_the_conditional_form_integrates_to_one(place):
    of, made = setting()
    model, state = SumOfGaussians(made, of, *widths(), evaluation="exact"), np.array(place)
    log_near = -0.5 * np.sum(((made.states - state) / widths()[0]) ** 2, axis=1)
    shares = np.exp(log_near - logsumexp(log_near))

    def near(rng):
        return made.strain[rng.choice(len(made), p=shares)] + WIDTHS[1] * rng.standard_normal(16)

    def log_density_near(measured):
        squared = np.sum(((measured - made.strain) / WIDTHS[1]) ** 2, axis=1)
        return logsumexp(np.log(shares + 1e-300) - 0.5 * squared) - 8 * math.log(2 * math.pi * WIDTHS[1] ** 2)

    total = densities.integral(
        lambda measured: float(model.log_likelihood(state[None], measured)[0]),
        near,
        log_density_near,
        densities.background(made.strain, WIDTHS[1]),
    )
    assert total == pytest.approx(1.0, abs=0.05)


def widths(dimension=2):
    return WIDTHS[0][:dimension], WIDTHS[1]


def test_the_conditional_form_does_not_prefer_densely_scanned_places():
    """Equal strains everywhere carry no information on the position, unless P(x) is constant."""
    rng = np.random.default_rng(0)
    states = 0.05 * rng.random((2000, 2)) ** [2.0, 1.0]
    uneven = Scan(
        states,
        0.005 * rng.standard_normal((2000, 16)),
        np.arange(2000) // 200,
        ("x", "y"),
        ("index", "middle"),
    )
    ask = np.stack([np.linspace(0.002, 0.048, 20), np.full(20, 0.025)], axis=1)
    measured = np.zeros(16)
    conditional, joint = (
        SumOfGaussians(uneven, scene(), *widths(), conditional=c).log_likelihood(ask, measured)
        for c in (True, False)
    )
    assert np.ptp(conditional) < 0.5
    assert np.ptp(joint) > 1.5
    assert joint[0] > joint[-1]


@given(seed=st.integers(0, 2**32 - 1))
def test_sum_of_gaussians_drops_an_absent_phalanx(seed):
    of, made = setting()
    alone = Scene("alone", of.axes, of.phalanges[1:], of.feature)
    rng = np.random.default_rng(seed)
    states = of.lower + rng.random((10, 2)) * 0.05
    measured = rng.standard_normal(16) * 0.3
    both = SumOfGaussians(made, of, *widths(), evaluation="exact")
    measured[:8] = rng.choice([np.nan, np.inf, 0.0, 1e300])
    found = both.log_likelihood(states, measured, np.array([False, True]))
    only = SumOfGaussians(made, alone, *widths(), evaluation="exact")
    np.testing.assert_allclose(found, only.log_likelihood(states, measured[8:]), atol=1e-9)


@pytest.mark.parametrize("evaluation", ["exact", "truncated", "field"])
def test_a_full_turn_axis_is_periodic(evaluation):
    of = scene(3, full_turn=True)
    made = scan(np.random.default_rng(1), of, 500)
    model = SumOfGaussians(made, of, *widths(3), evaluation=evaluation)
    states = np.array([[0.02, 0.03, yaw] for yaw in np.linspace(-3.1, 3.1, 20)])
    measured = strain_at(np.array([[0.02, 0.03, math.pi]]))[0]
    turned = states + np.array([0.0, 0.0, 2 * math.pi])
    np.testing.assert_allclose(
        model.log_likelihood(turned, measured), model.log_likelihood(states, measured), atol=0.02
    )


def test_pairs_beyond_a_turn_are_wrapped():
    of = scene(3, full_turn=True)
    made = scan(np.random.default_rng(1), of, 300)
    turned = Scan(
        made.states + np.array([0, 0, 4 * math.pi]), made.strain, made.sweep, made.axes, made.phalanges
    )
    states, measured = made.states[:5], made.strain[0]
    one, other = (SumOfGaussians(s, of, *widths(3), evaluation="exact") for s in (made, turned))
    np.testing.assert_allclose(
        one.log_likelihood(states, measured), other.log_likelihood(states, measured), atol=1e-6
    )


def test_unnamed_axes_and_phalanges_do_not_matter():
    _, made = setting(3, 3)
    part = Scene("part", (Axis("y", 0.0, 0.05),), (Phalanx("ring", (0.0,)),))
    by_hand = Scan(made.states[:, [1]], made.strain[:, 16:], made.sweep, ("y",), ("ring",))
    states, measured = np.linspace(0, 0.05, 9)[:, None], made.strain[3, 16:]
    one, other = (SumOfGaussians(s, part, 0.003, 0.05) for s in (made, by_hand))
    np.testing.assert_allclose(
        one.log_likelihood(states, measured), other.log_likelihood(states, measured), atol=1e-9
    )


def test_many_states_are_interpolated_and_agree_with_few():
    of, made = setting(pairs=2000)
    model = SumOfGaussians(made, of, *widths())
    states = of.lower + np.random.default_rng(0).random((20_000, 2)) * 0.05
    measured = strain_at(states[:1])[0]
    many = model.log_likelihood(states, measured)
    few = np.concatenate([model.log_likelihood(part, measured) for part in np.split(states, 500)])
    near = few > few.max() - 5
    assert np.abs(many - few)[near].max() < 0.02
    assert np.abs(many - few).max() < 1.0


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"position_std": 0.0}, "position_std: expected one or 2 positive numbers, got 0.0"),
        ({"position_std": [1, 2, 3]}, "position_std: expected one or 2"),
        ({"strain_std": -1.0}, "strain_std: expected one or 16 positive numbers, got -1.0"),
        ({"strain_std": math.nan}, "strain_std"),
        ({"strain_std": "wide"}, "strain_std: expected numbers, got 'wide'"),
        ({"evaluation": "fast"}, "evaluation 'fast'"),
        ({"precision": "float16"}, "precision 'float16': expected one of float64, float32"),
    ],
)
def test_an_invalid_parameter_is_named(wrong, message):
    of, made = setting()
    with pytest.raises(ParameterError, match=message):
        SumOfGaussians(made, of, **({"position_std": 0.003, "strain_std": 0.05} | wrong))


def test_a_scene_with_more_than_the_scan_is_refused():
    _, made = setting(2, 1)
    with pytest.raises(SceneError, match="phalanx 'middle' of scene 'test': expected one of index"):
        SumOfGaussians(made, scene(2, 2), *widths())
    with pytest.raises(SceneError, match="axis 'yaw'"):
        SumOfGaussians(made, scene(3, 1), *widths(3))


@pytest.mark.parametrize(
    ("strain", "present"),
    [
        (np.zeros(8), None),
        (np.full(16, np.nan), None),
        (np.full(16, np.inf), np.array([True, False])),
        (np.zeros(16), np.array([False, False])),
        (np.zeros(16), np.array([True])),
    ],
)
def test_an_unusable_strain_is_refused(strain, present):
    of, made = setting()
    with pytest.raises(MeasurementError):
        SumOfGaussians(made, of, *widths()).log_likelihood(np.zeros((3, 2)), strain, present)
