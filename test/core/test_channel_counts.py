"""Phalanges with any number of channels, and not all the same number."""

import numpy as np
import pytest
from support.scans import axes, scan, strain_at

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.scene import Phalanx, Region, Scene

COUNTS = (19, 6, 1)
GIVEN = {"position_std": 0.003, "strain_std": 0.06, "correlation_length": 0.001}


def scene(counts=COUNTS, feature=None):
    fingers = tuple(Phalanx(f"finger {f}", (0.0, 0.01 * f), n) for f, n in enumerate(counts))
    return Scene("test", axes(2), fingers, feature, GIVEN)


@pytest.mark.parametrize("counts", [COUNTS, (6,)])
@pytest.mark.parametrize("model", ["sum_of_gaussians", "gaussian", "gaussian_independent", "featureless"])
def test_every_model_localizes_with_any_channels(counts, model):
    of = scene(counts, Region((0.01, -np.inf), (0.04, np.inf)) if model == "featureless" else None)
    configuration, rng = Configuration(model=model, filter="grid"), np.random.default_rng(1)
    localizer = build_localizer(scan(np.random.default_rng(0), of, 800), of, configuration, rng)
    present = np.ones(len(counts), bool)
    for n in range(40):
        truth = np.array([0.01, 0.02]) + n * np.array([0.0006, 0.0002])
        present[-1] = n % 5 != 0 or len(counts) == 1
        felt = strain_at(truth[None], of.layout.size)[0]
        estimate = localizer.update(n * 10**7, truth + 3.0, felt, present)
    assert np.linalg.norm(estimate.mean - truth) < 0.002
