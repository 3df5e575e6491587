"""Simulated sessions show what the paper reports of its scans."""

from functools import cache

import numpy as np
import pytest

from tactile_localizer.sim import simulate_recording, simulate_sweep
from tactile_localizer.sim.deformation import mode_of_sweep
from tactile_localizer.sim.noise import child
from tactile_localizer.sim.scan import sweep_plan

WHOLE = ("bump", "snap", "grommet")
INCH = 0.0254


@cache
def sweeps_over(feature):
    return simulate_recording(feature, 1).sweeps


def test_training_scans_have_the_papers_size():
    sizes = [len(simulate_recording("bump", seed)) for seed in range(6)]
    assert np.mean(sizes) == pytest.approx(16_321, rel=0.01)


def test_training_lines_are_equidistant():
    lines = [np.median(sweep.truth[:, 1]) for sweep in sweeps_over("bump")]
    assert len(lines) == 21
    np.testing.assert_allclose(np.diff(lines), 0.1 * INCH, atol=0.8e-3)
    assert lines[-1] - lines[0] == pytest.approx(2 * INCH, abs=1e-3)


def test_test_sweeps_start_at_random_positions():
    starts = np.array([sweep_plan("test", number, 1)[0] for number in range(200)])
    off_line = np.abs(starts[:, 1] / (0.1 * INCH) - np.round(starts[:, 1] / (0.1 * INCH)))
    assert np.min(off_line) > 0.19
    assert np.ptp(starts[:, 0]) > 7e-3
    assert np.ptp(starts[:, 1]) > 1.9 * INCH


def test_almost_every_sweep_touches_the_feature():
    for feature in WHOLE:
        touching = [sweep.truth[list(sweep.contact), 0] for sweep in sweeps_over(feature) if sweep.felt.any()]
        assert len(touching) >= 20
        contact, end = np.transpose(touching)
        assert 0.35 < np.median(contact) / (2 * INCH) < 0.45
        assert 0.80 < np.median(end) / (2 * INCH) < 0.90


@pytest.mark.parametrize("feature", WHOLE)
def test_the_feature_exceeds_featureless_variation(feature):
    sweeps = sweeps_over(feature)
    featureless = [sweep.strain[(sweep.truth[:, 0] > 2e-3) & (sweep.truth[:, 0] < 12e-3)] for sweep in sweeps]
    strain = np.concatenate([sweep.strain for sweep in sweeps])
    between = np.std([np.mean(z, axis=0) for z in featureless], axis=0)
    within = np.mean([np.std(z, axis=0) for z in featureless], axis=0)
    assert 4e-3 < np.min(between) < np.max(between) < 25e-3
    assert 4e-3 < np.min(within) < np.max(within) < 25e-3
    assert 0.1 < np.min(np.ptp(strain, axis=0)) < np.max(np.ptp(strain, axis=0)) < 2.0


def test_gauges_respond_to_edge_or_height():
    """Paper, Fig. 3 (c) and (d): one element changes sign along the sweep, another across the sweeps."""
    sweeps = sweeps_over("bump")
    truth = np.concatenate([sweep.truth for sweep in sweeps])
    strain = np.concatenate([sweep.strain for sweep in sweeps])
    strain = strain - np.median(strain, axis=0)

    def edge_and_height(x, y):
        near = (np.abs(truth - (x, y)) < 2e-3).all(axis=1)
        return np.mean(strain[near], axis=0)[[0, 2]]

    before = [edge_and_height(25e-3, y) for y in (7e-3, 20e-3)]
    after = [edge_and_height(39e-3, y) for y in (7e-3, 20e-3)]
    assert before[0][0] > 0.05 < before[1][0]
    assert after[0][0] < -0.05 > after[1][0]
    assert before[0][1] * before[1][1] < 0 > after[0][1] * after[1][1]
    assert before[0][1] * after[0][1] > 0


@pytest.mark.parametrize("feature", WHOLE)
def test_strain_is_multimodal_on_the_first_part(feature):
    """Paper, Fig. 6: modes differ more from each other than sweeps of one mode, and later less so."""
    seed, edge, x = 3, 0, np.arange(18e-3, 42e-3, 1e-3)
    modes = [mode_of_sweep(child(seed, WHOLE.index(feature), 0, 1 << 30), number) for number in range(30)]
    sweeps = [simulate_sweep(feature, seed, number, "train", start=(0.0, 0.009)) for number in range(30)]
    courses = np.array([np.interp(x, sweep.truth[:, 0], sweep.strain[:, edge]) for sweep in sweeps])
    apart = np.array([_separation(values, modes) for values in courses.T])
    first, last = apart[x < 30e-3], apart[x > 36e-3]
    assert np.max(first) > 2
    assert np.mean(last) < np.mean(first) / 1.5


def _separation(values, modes):
    """Standard deviation of the modes' medians over that within the modes."""
    groups = [values[np.equal(modes, mode)] for mode in sorted(set(modes))]
    assert len(groups) == 3
    within = np.median(np.concatenate([np.abs(group - np.median(group)) for group in groups])) / 0.6745
    return np.std([np.median(group) for group in groups]) / within
