"""Phalanges with any number of channels, and not all the same number."""

import numpy as np
import pytest
from support.scans import SIDE, axes

from tactile_localizer.core.calibration.held_out import Calibration
from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.core.likelihood.strain_map import VarianceModel
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.tactile_map import make_map
from tactile_localizer.errors import MeasurementError
from tactile_localizer.scene import Phalanx, Region, Scene

COUNTS = (19, 6, 1)
CALIBRATION = Calibration(0.001, np.array([0.0004, 0.0004]), VarianceModel())
"""Given, so that no test waits for it to be learned."""
GIVEN = {"position_std": 0.003, "strain_std": 0.06, "correlation_length": 0.001}


def scene(counts=COUNTS, feature=None):
    names = ("index", "middle", "ring")
    phalanges = (
        Phalanx(name, (0.0, 0.01 * f), n) for f, (name, n) in enumerate(zip(names, counts, strict=False))
    )
    return Scene("test", axes(2), tuple(phalanges), feature, GIVEN)


def strain_at(states, size):
    channel = np.arange(size)
    return 0.3 * np.sin(
        2 * np.pi / SIDE * states @ np.stack([1 + channel % 2, 1 + channel % 3]) + 0.7 * channel
    )


def scan(of, pairs=1200):
    rng = np.random.default_rng(0)
    states = of.lower + rng.random((pairs, 2)) * (of.upper - of.lower)
    strain = strain_at(states, of.layout.size) + 0.02 * rng.standard_normal((pairs, of.layout.size))
    sweep = np.arange(pairs) * 10 // pairs
    return Scan(states, strain, sweep, of.axis_names, of.phalanx_names, of.layout.counts)


@pytest.mark.parametrize("counts", [COUNTS, (16, 16), (6,)])
@pytest.mark.parametrize("model", ["sum_of_gaussians", "gaussian", "gaussian_independent", "featureless"])
def test_every_model_localizes_with_any_channels(counts, model):
    of = scene(counts, Region((0.01, -np.inf), (0.04, np.inf)) if model == "featureless" else None)
    configuration, rng = Configuration(model=model, filter="grid"), np.random.default_rng(1)
    localizer = build_localizer(scan(of), of, configuration, rng, None, CALIBRATION)
    present = np.ones(len(counts), bool)
    for n in range(40):
        truth = np.array([0.01, 0.02]) + n * np.array([0.0006, 0.0002])
        present[-1] = n % 5 != 0 or len(counts) == 1
        felt = strain_at(truth[None], of.layout.size)[0]
        estimate = localizer.update(n * 10**7, truth + 3.0, felt, present)
    assert np.linalg.norm(estimate.mean - truth) < 0.002


def test_a_strain_of_another_length_is_refused():
    of = scene()
    localizer = build_localizer(scan(of), of, Configuration(), np.random.default_rng(1), None, CALIBRATION)
    with pytest.raises(MeasurementError, match=r"expected shape \(26,\), got \(24,\)"):
        localizer.update(0, np.zeros(2), np.zeros(24))


def test_maps_have_the_channels_of_each_phalanx():
    of = scene()
    tactile_map = make_map(scan(of), of)
    assert [tactile_map.phalanx(name).shape[-1] for name in of.phalanx_names] == [19, 6, 1]
