"""Phalanges with any number of channels, and not all the same number."""

from dataclasses import replace

import numpy as np
import pytest
from support.scans import axes, bump_scan, scan, strain_at

from tactile_localizer.core.calibration.calibration import Calibration
from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.scene import Phalanx, Region, Scene

COUNTS = (19, 6, 1)
KNOWN = Calibration(np.full(2, 0.0015))
ON_SHEET = KNOWN._replace(material=Material.SHEET)


def scene(counts=COUNTS, feature=None):
    fingers = tuple(Phalanx(f"finger {f}", (0.0, 0.01 * f), n) for f, n in enumerate(counts))
    return Scene("test", axes(2), fingers, feature)


@pytest.mark.parametrize("counts", [COUNTS, (6,)])
@pytest.mark.parametrize("model", ["SumOfGaussians", "Gaussian", "IndependentGaussian", "Featureless"])
def test_every_model_localizes_with_any_channels(counts, model):
    of = scene(counts, Region((0.01, -np.inf), (0.04, np.inf)) if model == "Featureless" else None)
    configuration, rng = Configuration(model=f"tactile_localizer.paper:{model}"), np.random.default_rng(1)
    scanned = scan(np.random.default_rng(0), of, 800)
    localizer = build_localizer(scanned, of, configuration, rng, calibration=KNOWN)
    present = np.ones(len(counts), bool)
    for n in range(40):
        truth = np.array([0.01, 0.02]) + n * np.array([0.0006, 0.0002])
        present[-1] = n % 5 != 0 or len(counts) == 1
        felt = strain_at(truth[None], of.layout.size)[0]
        estimate = localizer.update(n * 10**7, truth + 3.0, felt, present)
    assert np.linalg.norm(estimate.mean - truth) < 0.002


def test_the_level_of_a_sweep_does_not_move_the_position_of_another_model() -> None:
    """On featureless material before the bump it becomes known, and is subtracted."""
    of = Scene("sheet", axes(2), (Phalanx("finger", (0.0, 0.0), 4),))
    configuration = Configuration(model="tactile_localizer.paper:SumOfGaussians")
    scanned, rng = bump_scan(of, offsets=1.0), np.random.default_rng(0)
    localizer = build_localizer(scanned, of, configuration, rng, calibration=ON_SHEET)
    way = np.column_stack([np.arange(0.002, 0.026, 0.0005), np.full(48, 0.024)])
    bump = 30.0 * np.exp(-0.5 * np.sum(((way - 0.025) / 0.004) ** 2, axis=1))[:, None]
    felt, ends = bump * np.linspace(-1.0, 1.0, 4), []
    for level in (0.0, 4.0):
        localizer.reset()
        for n, (place, strain) in enumerate(zip(way, felt + level, strict=True)):
            estimate = localizer.update(n * 10**7, place, strain)
        ends.append(estimate.mean)
    np.testing.assert_allclose(ends[1], ends[0], atol=5e-4)
    assert estimate.on_map > 0.2, "another session differs by more than the sweeps of the scan"
    assert np.linalg.norm(ends[1] - way[-1]) < 0.003


@pytest.mark.parametrize("axis", ["straight", "turned"])
def test_more_channels_than_directions_of_the_signal_are_not_worse(axis: str) -> None:
    """Other material of the map's one direction does not win over a map whose errors are of all channels."""
    ways, travels = np.column_stack([np.arange(0.002, 0.048, 0.0005), np.full(92, 0.0237)]), []
    for channels in (8, 64, 200):
        of = Scene("sheet", axes(2), (Phalanx("finger", (0.0, 0.0), channels),))
        mixing = np.eye(channels)
        if axis == "turned":
            mixing = np.linalg.qr(np.random.default_rng(1).standard_normal((channels, channels)))[0]
        scanned = bump_scan(of)
        scanned = replace(scanned, strain=scanned.strain @ mixing)
        rng = np.random.default_rng(0)
        localizer = build_localizer(scanned, of, Configuration(), rng, calibration=ON_SHEET)
        rng, converged = np.random.default_rng(2), 0
        for n, place in enumerate(ways):
            bump = 30.0 * np.exp(-0.5 * np.sum(((place - 0.025) / 0.004) ** 2))
            felt = bump * np.linspace(-1.0, 1.0, channels) + rng.standard_normal(channels)
            estimate = localizer.update((1 + n) * 10**7, place, felt @ mixing)
            converged += estimate.converged
        assert np.linalg.norm(estimate.mean - place) < 0.003
        travels.append(converged)
    assert min(travels) > 0.9 * travels[0] > 10
