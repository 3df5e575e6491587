"""The model of a scan that is known in closed form: equal sweeps over constant strains and pure waves."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_t
from support.models import noise_model, whitened_scan
from support.scans import slides

from tactile_localizer.core.calibration.sweep_model import SweepModel, learn_sweep_model
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.core.likelihood.strain_map import VarianceModel
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Axis, Phalanx, Scene

PITCH, VISIT = 0.001, 1.7
LINE = Scene(
    "line", (Axis("x", 0.0, 0.1, 0.003),), (Phalanx("index", (0.0,), 2), Phalanx("thumb", (0.0,), 3))
)
FIRM, FAINT = np.array([3.0, -4.0]), np.array([0.3, 0.0, -0.4])
"""Strain of the index on the second half of the line, a tenth of it over 10 mm before; and amplitude of a
wave that the thumb feels, in standard deviations of a visit."""
DEGREES = 8.0


def line_scan() -> Scan:
    """Two equal sweeps along the line; the wave has ten whole periods."""
    x = np.arange(0.0005, 0.1, PITCH)
    index = np.outer((x > 0.05) + 0.1 * ((x > 0.04) & (x < 0.05)), FIRM)
    thumb = np.outer(np.sin(2.0 * math.pi * x / 0.01), FAINT)
    return slides(LINE, x, [np.hstack([index, thumb])] * 2)


def model(level_variance: float = 0.0) -> SweepModel:
    return of_sweeps(line_scan(), level_variance)


def of_sweeps(scan: Scan, level_variance: float = 0.0) -> SweepModel:
    """Strains in standard deviations of a visit, all of them signal."""
    noise = noise_model(LINE.layout, level_variance=level_variance)
    whitened = whitened_scan(scan, LINE)._replace(noise=noise)
    return SweepModel(whitened, VarianceModel(visit=VISIT, interpolation=0.0))


def mixture(of: SweepModel):
    return of.mixture(LINE, np.array([2.0 * PITCH]))


def halfway(values: np.ndarray) -> np.ndarray:
    """Eigenvalues halfway, geometrically, to their mean."""
    return np.sqrt(values * values.mean())


def test_the_map_expects_what_equal_sweeps_felt() -> None:
    found = mixture(model())
    nodes, expected = found.map_at(np.array([[0.0205], [0.0805]]))
    np.testing.assert_allclose(expected[:, :2], [[0.0, 0.0], FIRM], atol=1e-5)
    wave = math.sin(2.0 * math.pi * 0.05)
    np.testing.assert_allclose(expected[:, 2:], wave * np.array([FAINT, FAINT]), atol=1e-5)
    # The mean of two sweeps has half the noise of one, but where both are exactly featureless.
    np.testing.assert_allclose(found.map.variance[nodes, 0], VISIT * np.array([[1.0, 1.5], [1.5, 1.5]]))


def test_a_level_is_known_by_its_prior_in_the_median_variance_of_a_visit() -> None:
    drift = mixture(model(level_variance=0.5)).drift
    median = 1.5 * VISIT
    np.testing.assert_allclose(drift.prior, median / 0.5)
    assert drift.variance == pytest.approx(median)
    assert drift.memory == math.inf


def test_an_innovation_as_large_as_a_hundred_times_the_largest_signal_counts_half() -> None:
    drift = mixture(model(level_variance=0.5)).drift
    peak = 25.0 + 0.25 * math.sin(2.0 * math.pi * 0.25) ** 2
    largest = 100.0 * (peak + 5 * 1.5 * VISIT)
    strain, nowhere = np.full(5, math.sqrt(largest / 5.0)), np.zeros((0, 5), dtype=np.float32)
    _, trend = drift.update(drift.start(0), strain, nowhere, PITCH, 1.0)
    assert trend.measurements == pytest.approx(0.5, abs=2e-4)


def test_other_material_is_a_mixture_of_the_maps_signal_at_six_strengths() -> None:
    """The shape is that of where a phalanx feels something, or of all where it hardly does anywhere."""
    other = mixture(model()).other
    index, thumb = np.outer(FIRM, FIRM), 0.5 * np.outer(FAINT, FAINT)
    used, level = np.ones(2, dtype=bool), np.array([0.2, 0.4])

    def total(strain: np.ndarray) -> float:
        """Log-likelihood, but for a constant."""
        sum_of_phalanges = 0.0
        # The thumb feels something everywhere, so no place of its map has only the noise of a visit.
        parts = ((strain[:2], index, VISIT + level[0]), (strain[2:], thumb, 1.5 * VISIT + level[1]))
        for felt, covariance, variance in parts:
            values, vectors = np.linalg.eigh(covariance)
            strengths = halfway(np.maximum(values, 0.0))
            spread = [g * strengths for g in (0.0, 0.03, 0.1, 0.3, 1.0, 3.0)]
            spread.append(np.full(len(felt), 3.0 * strengths.max()))
            shapes = [vectors @ np.diag(each + variance) @ vectors.T for each in spread]
            densities = [multivariate_t.logpdf(felt, shape=shape, df=DEGREES) for shape in shapes]
            sum_of_phalanges += logsumexp(densities) - math.log(7.0)
        return sum_of_phalanges

    def found(strain: np.ndarray) -> float:
        return other.update(other.start(), strain, level, used, PITCH, 1.0)[0]

    nothing = np.zeros(5)
    for strain in (
        np.array([3.0, -4.0, 0, 0, 0]),
        np.array([4.0, 3.0, 0, 0, 0]),
        np.array([0, 0, 2.0, 1.0, 0]),
    ):
        assert found(strain) - found(nothing) == pytest.approx(total(strain) - total(nothing), rel=0.01)


def test_a_part_keeps_its_points_and_the_noise_and_variance_of_all() -> None:
    of = model()
    tracks = of.scan.tracks
    kept = (tracks.number == 1) & (tracks.positions[:, 0] > 0.03)
    levels = np.arange(10.0).reshape(2, 5)
    part = of._replace(scan=of.scan._replace(levels=levels)).part(kept)
    assert part.variance is of.variance
    assert part.scan.noise is of.scan.noise
    assert part.scan.held_out is None
    np.testing.assert_array_equal(part.scan.signal, of.scan.signal[kept])
    np.testing.assert_array_equal(part.scan.tracks.positions, tracks.positions[kept])
    np.testing.assert_array_equal(part.scan.levels, levels[1:])


def test_cells_have_the_size_of_lines_and_on_one_axis_a_quarter_of_a_pitch() -> None:
    plane = Scene(
        "plane", (Axis("x", 0.0, 0.1, 0.003), Axis("y", 0.0, 0.02, 0.003)), (Phalanx("index", (0.0, 0.0)),)
    )
    whitened = whitened_scan(line_scan(), LINE)._replace(spacing=0.004)
    of = SweepModel(whitened, VarianceModel())
    np.testing.assert_allclose(of.cell(LINE, 0.5), [0.0005 / 4.0])
    np.testing.assert_allclose(of.cell(plane, 0.5), [0.002, 0.002])


def test_a_variance_that_is_given_is_not_fitted() -> None:
    given, rng, x = VarianceModel(visit=0.123), np.random.default_rng(0), np.arange(0.0005, 0.1, PITCH)
    scan = slides(LINE, x, [rng.standard_normal((100, 5)) for _ in range(3)])
    assert learn_sweep_model(scan, LINE, Material.CLOTH, given).variance is given
    assert learn_sweep_model(scan, LINE, Material.CLOTH).variance != given
