"""White noise of raw channels, in the scan and in the sweep at hand."""

import numpy as np
import pytest
from support.scans import slides

from tactile_localizer.core.likelihood.white_noise import SweepNoise, white_noise
from tactile_localizer.scene import Axis, Phalanx, Scene

LENGTH, PITCH = 2.0, 0.0005
SCENE = Scene("line", (Axis("x", 0.0, LENGTH),), (Phalanx("index", (0.0,), 3),))
WIDTH = np.array([0.1, 1.0, 10.0])
EVERY = np.ones(3, dtype=bool)


def felt(spacing: float, seed: int, factor: np.ndarray | float = 1.0) -> np.ndarray:
    """Waves of 60 noise widths over 40 mm and noise of ``factor`` variances, every ``spacing`` m, (n, 3)."""
    x = np.arange(0.0, LENGTH, spacing)
    wave = 60.0 * np.sin(x[:, None] * 2.0 * np.pi / 0.04 + [0.0, 1.0, 2.0])
    noise = np.random.default_rng(seed).standard_normal((len(x), 3))
    return np.asarray(WIDTH * (wave + np.sqrt(factor) * noise))


SCAN = white_noise(
    slides(SCENE, np.arange(0.0, LENGTH, PITCH), [felt(PITCH, seed) for seed in range(3)]), SCENE
)


def mean_excess(strain: np.ndarray, spacing: float, pitch: float | None = None) -> np.ndarray:
    """Mean excess over a sweep (C,), in variances of the scan's noise."""
    sweep, found = SweepNoise(SCAN), []
    for row in strain:
        sweep.observe(row, EVERY, spacing)
        found.append(sweep.excess(spacing if pitch is None else pitch).diagonal())
    return np.asarray(np.mean(found[200:], axis=0) / WIDTH**2)


def test_the_noise_of_a_scan_is_measured_through_its_signal() -> None:
    assert SCAN.spacing[0] == pytest.approx(PITCH)
    np.testing.assert_allclose(SCAN.variance[0], WIDTH**2, rtol=0.2)
    assert (np.diff(SCAN.variance, axis=0) > 0.0).all(), "farther apart there is more of the signal in it"


@pytest.mark.parametrize("factor", [2.0, 5.0])
def test_noise_beyond_that_of_the_scan_is_measured(factor: float) -> None:
    """Within some per cent, as the strains of a sweep are few and each has a part of the signal."""
    excess = mean_excess(felt(PITCH, 9, factor), PITCH)
    np.testing.assert_allclose(1.0 + excess, factor, rtol=0.08)


@pytest.mark.parametrize("spacing", [0.5 * PITCH, PITCH, 2.0 * PITCH])
def test_a_sweep_like_the_scan_has_none_at_any_spacing_of_its_strains(spacing: float) -> None:
    """But for one that exceeds two standard errors by chance."""
    assert mean_excess(felt(spacing, 9), spacing).max() < 0.03


def test_one_noisy_channel_is_found_among_the_others() -> None:
    excess = mean_excess(felt(PITCH, 9, np.array([1.0, 9.0, 1.0])), PITCH)
    np.testing.assert_allclose(excess, [0.0, 8.0, 0.0], atol=0.5)


def test_a_channel_of_ten_noise_widths_is_known_within_thirty_strains() -> None:
    """No more may come before contact. A channel that is like the scan's is hardly ever taken for noisy."""
    sweep, found = SweepNoise(SCAN), []
    for seed in range(20):
        sweep.reset()
        for row in felt(PITCH, seed, np.array([1.0, 100.0, 1.0]))[:30]:
            sweep.observe(row, EVERY, PITCH)
        found.append(sweep.excess(PITCH).diagonal() / WIDTH**2)
    excess = np.array(found)
    assert np.median(excess[:, 1]) > 20.0
    assert np.mean(excess[:, [0, 2]] > 0.0) < 0.1


def test_noise_that_is_common_to_the_channels_leaves_their_differences_as_they_were() -> None:
    """As of a force that trembles."""
    common = 10.0 * np.random.default_rng(4).standard_normal((1000, 1))
    sweep, found = SweepNoise(SCAN), []
    for row in felt(PITCH, 9)[:1000] + WIDTH * common:
        sweep.observe(row, EVERY, PITCH)
        found.append(sweep.excess(PITCH) / np.outer(WIDTH, WIDTH))
    excess, across = np.mean(found[200:], axis=0), np.array([1.0, -1.0, 0.0]) / np.sqrt(2.0)
    np.testing.assert_allclose(excess.diagonal(), 100.0, rtol=0.2)
    assert across @ excess @ across < 5.0


def test_channels_that_are_as_quiet_as_in_the_scan_do_not_hide_what_is_common_to_the_others() -> None:
    many = Scene("line", SCENE.axes, (Phalanx("index", (0.0,), 40),))
    x, rng = np.arange(0.0, 0.1, PITCH), np.random.default_rng(0)
    scan = white_noise(slides(many, x, [rng.standard_normal((len(x), 40)) for _ in range(3)]), many)
    sweep, common = SweepNoise(scan), np.where(np.arange(40) < 2, 10.0, 0.0)
    for row in rng.standard_normal((len(x), 40)) + common * rng.standard_normal((len(x), 1)):
        sweep.observe(row, np.ones(40, dtype=bool), PITCH)
        excess = sweep.excess(PITCH)
    assert excess[0, 1] > 0.6 * np.sqrt(excess[0, 0] * excess[1, 1])


def test_noise_that_is_not_common_is_not_by_chance() -> None:
    """Twelve strains have large correlations."""
    smallest = []
    for seed in range(20):
        sweep = SweepNoise(SCAN)
        for row in felt(PITCH, seed, 25.0)[:12]:
            sweep.observe(row, EVERY, PITCH)
        smallest.append(np.linalg.eigvalsh(sweep.excess(PITCH) / np.outer(WIDTH, WIDTH))[0])
    assert np.median(smallest) > 3.0


def test_a_mean_of_strains_has_a_part_of_their_noise() -> None:
    strain = felt(PITCH, 9, 3.0)
    np.testing.assert_allclose(mean_excess(strain, PITCH, 5.0 * PITCH), mean_excess(strain, PITCH) / 5.0)


def test_a_channel_that_is_absent_keeps_its_noise() -> None:
    sweep = SweepNoise(SCAN)
    for row in felt(PITCH, 9, 5.0):
        sweep.observe(np.where([True, False, True], row, 1e9), np.array([True, False, True]), PITCH)
    excess = sweep.excess(PITCH).diagonal()
    assert excess[1] == 0.0
    assert (excess[[0, 2]] > WIDTH[[0, 2]] ** 2).all()
    sweep.reset()
    assert not sweep.excess(PITCH).any()


def test_strains_of_a_single_pair_have_no_noise_to_measure() -> None:
    one = white_noise(slides(SCENE, np.zeros(1), [np.ones((1, 3))]), SCENE)
    np.testing.assert_array_equal(one.at(PITCH), 0.0)


def test_sweeps_of_four_strains_have_noise_at_one_spacing() -> None:
    short = white_noise(
        slides(SCENE, PITCH * np.arange(4.0), [felt(PITCH, seed)[:4] for seed in range(9)]), SCENE
    )
    assert len(short.spacing) == 1
    np.testing.assert_array_equal(short.at(0.5 * PITCH), short.variance[0])


def cleaned(strain: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A sweep (n, 3) without spikes, and their number in each channel."""
    sweep = SweepNoise(SCAN)
    return np.array([sweep.observe(row, EVERY, PITCH) for row in strain]), sweep.spikes


@pytest.mark.parametrize("row", [0, 1, 2, 50])
@pytest.mark.parametrize("widths", [100.0, -1e6, 1e90])
def test_a_single_value_far_off_counts_as_what_those_before_it_predict(row: int, widths: float) -> None:
    plain = felt(PITCH, 9)[:100]
    spoiled = plain.copy()
    spoiled[row, 1] += widths * WIDTH[1]
    found, spikes = cleaned(spoiled)
    later = slice(max(row, 2), None)  # before the third strain nothing is predicted
    np.testing.assert_allclose(found[later], plain[later], atol=20.0 * WIDTH.max())
    np.testing.assert_allclose(found[row + 2 :], plain[row + 2 :])
    assert spikes.tolist() == [0, int(row >= 2), 0]


def test_the_first_strain_beyond_an_edge_is_replaced_but_no_spike() -> None:
    strain = felt(PITCH, 9)[:100]
    strain[50:] += 1000.0 * WIDTH
    found, spikes = cleaned(strain)
    np.testing.assert_allclose(np.delete(found, 50, axis=0), np.delete(strain, 50, axis=0))
    assert not spikes.any()


def test_the_white_noise_of_a_channel_that_never_changes_is_finite() -> None:
    strain = felt(PITCH, 0)
    strain[:, 0] = 7.0
    with np.errstate(all="raise"):
        noise = white_noise(slides(SCENE, np.arange(0.0, LENGTH, PITCH), [strain]), SCENE)
    assert np.isfinite(noise.variance).all()
    np.testing.assert_allclose(noise.variance[:, 0], 0.0, atol=1e-290)


def test_much_more_noise_is_known_after_a_dozen_strains() -> None:
    sweep = SweepNoise(SCAN)
    for strain in felt(PITCH, 9, 25.0)[:12]:
        sweep.observe(strain, EVERY, PITCH)
    assert (sweep.excess(PITCH).diagonal() > 3.0 * WIDTH**2).all()
