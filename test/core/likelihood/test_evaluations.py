"""Evaluations of the kernel models agree with the exact one on simulated features.

Bounds: total variation of the weights 2e-3, shift of the posterior mean 1e-4 of the state's range, and
log-likelihoods within 5 nats of the peak to 0.02.
"""

from functools import partial

import numpy as np
import pytest
from support.scans import density, scan, scene, strain_at, total_variation

from tactile_localizer.core.likelihood.featureless import Featureless
from tactile_localizer.core.likelihood.sum_of_gaussians import SumOfGaussians
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.resources import resource_path
from tactile_localizer.scene import Axis, Phalanx, Scene
from tactile_localizer.sim import simulate_scan

PAPER = {"position_std": 0.0254 * np.sqrt(0.0075), "strain_std": np.sqrt(0.001)}
TUNED = {
    "position_std": np.array([0.00282, 0.00282]),
    "strain_std": np.array([0.0195, 0.017, 0.026, 0.0119, 0.0169, 0.017, 0.0313, 0.0116] * 2),
}
"""As chosen from three scans of a grommet."""
QUICK = [
    {"evaluation": "truncated"},
    {"evaluation": "field"},
    {"evaluation": "field", "precision": "float32"},
]
CLOUDS = ["spread", "converged", "wrong"]
"""All over the scene; about the truth; about some other place."""


def cloud(kind, of, truth, particles, rng, std):
    if kind == "spread":
        return of.lower + rng.random((particles, of.dimension)) * (of.upper - of.lower)
    centre = truth if kind == "converged" else of.lower + rng.random(of.dimension) * (of.upper - of.lower)
    return np.clip(centre + std * rng.standard_normal((particles, of.dimension)), of.lower, of.upper)


def compare(of, build, truths, strains, kind, std):
    """Every quick evaluation against the exact one: 75 states for every strain, 1,000 for the first."""
    rng = np.random.default_rng(0)
    exact, quick = build(evaluation="exact"), [build(**options) for options in QUICK]
    for number, (truth, strain) in enumerate(zip(truths, strains, strict=True)):
        for particles in (75, 1000)[: 1 if number else 2]:
            states = cloud(kind, of, truth, particles, rng, std)
            expected = exact.log_likelihood(states, strain)
            near, weights = expected > expected.max() - 5.0, density(expected)
            for model in quick:
                found = model.log_likelihood(states, strain)
                assert np.abs(found - expected)[near].max() <= 0.02
                assert total_variation(density(found), weights) <= 2e-3
                assert (np.abs((density(found) - weights) @ states) / (of.upper - of.lower)).max() <= 1e-4


@pytest.mark.parametrize("kind", CLOUDS)
@pytest.mark.parametrize("feature", ["bump", "snap", "grommet"])
@pytest.mark.parametrize("model", [SumOfGaussians, Featureless])
def test_evaluations_agree_on_simulated_features(model, feature, kind):
    of = load_scene(resource_path(f"config/scenes/{feature}.yaml"))
    made, test = simulate_scan(feature, 1).to_scan(), simulate_scan(feature, 1, "test")
    rows = np.random.default_rng(1).integers(len(test), size=6)
    for widths in (PAPER, TUNED):
        compare(of, partial(model, made, of, **widths), test.truth[rows], test.strain[rows], kind, 0.0012)


@pytest.mark.parametrize("kind", CLOUDS)
def test_evaluations_agree_on_one_axis(kind):
    made, test = simulate_scan("bump", 1).to_scan(), simulate_scan("bump", 1, "test")
    of = Scene("line", (Axis("x", 0.0, 0.051),), (Phalanx("middle", (0.0,)),))
    rows = np.random.default_rng(1).integers(len(test), size=6)
    build = partial(SumOfGaussians, made, of, **PAPER)
    compare(of, build, test.truth[rows, :1], test.strain[rows, 8:], kind, 0.0012)


@pytest.mark.parametrize("kind", CLOUDS)
@pytest.mark.parametrize("full_turn", [False, True])
def test_evaluations_agree_on_three_axes(full_turn, kind):
    of = scene(3, 2, full_turn=full_turn)
    made = scan(np.random.default_rng(1), of, 3000)
    truths = of.lower + np.random.default_rng(2).random((6, 3)) * (of.upper - of.lower)
    build = partial(SumOfGaussians, made, of, np.array([0.003, 0.003, 0.15]), 0.06)
    compare(of, build, truths, strain_at(truths), kind, np.array([0.0015, 0.0015, 0.05]))
