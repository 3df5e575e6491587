"""Every sweep has an offset of its own, which shows on featureless material and is removed everywhere."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.strip import CENTRE, OFFSETS, SCAN, SCENE, SWEEPS, felt, scanned

from tactile_localizer.core.sweep_offset import SweepOffset, knows_offsets
from tactile_localizer.errors import SceneError
from tactile_localizer.scene import Scene

BOTH = np.ones(2, dtype=bool)
STEP = 0.003
NOISE = 0.005


def test_the_sweeps_of_a_scan_feel_alike_after_their_offsets_are_removed() -> None:
    removed = SweepOffset(SCAN, SCENE).removed_from(SCAN, SCENE)
    at_the_peak = np.abs(SCAN.states[:, 0] - 0.05) < 0.0005
    assert np.ptp(SCAN.strain[at_the_peak], axis=0).mean() > 0.08
    assert np.ptp(removed.strain[at_the_peak], axis=0).mean() < 0.03


def test_the_offset_of_a_new_sweep_is_learned_before_the_feature_and_held_over_it() -> None:
    rng = np.random.default_rng(5)
    own = rng.normal(0.0, 0.03, 16)
    x = np.arange(0.0, 0.1, STEP)
    offset = SweepOffset(SCAN, SCENE)
    corrected = np.stack([offset.corrected(strain, BOTH, STEP) for strain in felt(x, own, rng)])
    # The scan's own centre is known only as well as the mean of its sweeps.
    expected = felt(x, OFFSETS.mean(axis=0), rng)
    late = x > 0.02
    assert np.sqrt(np.mean((corrected - expected)[late] ** 2)) < 0.01


@pytest.mark.parametrize("spread", [0.03, 0.06])
def test_however_a_new_sweep_differs_its_offset_is_learned(spread: float) -> None:
    """Few sweeps say little of how channels go together; a new one may differ in another way, and more."""
    rng = np.random.default_rng(7)
    offset = SweepOffset(SCAN, SCENE)
    missed = []
    for own in rng.normal(0.0, spread, (60, 16)):
        offset.reset()
        strains = felt(np.arange(0.0, 0.03, STEP), own, rng)
        corrected = [offset.corrected(strain, BOTH, STEP) for strain in strains]
        missed.append(np.sqrt(np.mean((strains[-1] - corrected[-1] - (own - OFFSETS.mean(axis=0))) ** 2)))
    assert np.quantile(missed, 0.9) < 0.005


def test_featureless_strains_of_a_new_sweep_are_as_likely_as_its_offset_is_known() -> None:
    rng = np.random.default_rng(8)
    offset = SweepOffset(SCAN, SCENE)
    first, last, alone = [], [], []
    for own in rng.normal(0.0, 0.03, (40, 16)):
        offset.reset()
        strains = felt(np.arange(0.0, 0.03, STEP), own, rng)
        first.append(offset.log_density(strains[0], BOTH))
        alone.append(sum(offset.log_density(strains[0], phalanx) for phalanx in np.eye(2, dtype=bool)))
        for strain in strains[:-1]:
            offset.corrected(strain, BOTH, STEP)
        last.append(offset.log_density(strains[-1], BOTH))
    at_first, known = (2.0 * 0.03) ** 2 + NOISE**2, NOISE**2
    normal = [
        -8.0 * (np.log(2.0 * np.pi * variance) + spread / variance)
        for variance, spread in ((at_first, 0.03**2 + NOISE**2), (known, NOISE**2))
    ]
    assert [np.mean(first), np.mean(last)] == pytest.approx(normal, abs=5.0)
    assert alone == pytest.approx(first), "phalanges are independent"


def test_a_phalanx_that_is_not_felt_learns_nothing() -> None:
    offset = SweepOffset(SCAN, SCENE)
    strain = CENTRE + 0.03
    strain[8:] = 0.0
    for _ in range(10):
        corrected = offset.corrected(strain, np.array([True, False]), STEP)
    assert np.array_equal(corrected[8:], strain[8:])
    assert np.abs(corrected[:8] - CENTRE[:8]).max() < 0.02


def test_a_new_sweep_forgets_the_last_one() -> None:
    offset = SweepOffset(SCAN, SCENE)
    first = offset.corrected(CENTRE + 0.02, BOTH, STEP)
    offset.corrected(CENTRE - 0.02, BOTH, STEP)
    offset.reset()
    assert np.array_equal(offset.corrected(CENTRE + 0.02, BOTH, STEP), first)


@given(st.integers(1, 30), st.floats(0.0003, 0.01))
def test_steady_looks_shrink_the_offset_as_a_gaussian_prior_does(looks: int, travel: float) -> None:
    offset = SweepOffset(SCAN, SCENE)
    strain = SCAN.strain[:40].mean(axis=0)
    for _ in range(looks):
        corrected = offset.corrected(strain, BOTH, travel)
    at_once = SweepOffset(SCAN, SCENE)
    # Many looks of little travel are one look of their travel: precisions add.
    together = at_once.corrected(strain, BOTH, STEP)
    share = min(1.0, travel / STEP) * looks
    prior, white = at_once._prior, at_once._whiten @ (strain - at_once._centre)
    assert corrected == pytest.approx(strain - at_once._shape @ (white * prior / (prior + 1.0 / share)))
    assert together == pytest.approx(strain - at_once._shape @ (white * prior / (prior + 1.0)))


def test_sweeps_that_do_not_differ_leave_next_to_nothing_to_remove() -> None:
    offset = SweepOffset(scanned(np.zeros((SWEEPS, 16))), SCENE)
    strain = CENTRE + 0.006
    for _ in range(3):
        corrected = offset.corrected(strain, BOTH, STEP)
    assert np.abs(strain - corrected).max() < 0.003


@pytest.mark.parametrize("volts", [0.0, 1e-300, 1e99, -1e99])
def test_a_strain_far_from_all_others_teaches_nothing(volts: float) -> None:
    offset = SweepOffset(SCAN, SCENE)
    before = offset.corrected(CENTRE + 0.02, BOTH, STEP)
    offset.corrected(np.full(16, volts), BOTH, STEP)
    again = SweepOffset(SCAN, SCENE)
    again.corrected(CENTRE + 0.02, BOTH, STEP)
    assert offset.corrected(CENTRE + 0.02, BOTH, STEP) == pytest.approx(
        again.corrected(CENTRE + 0.02, BOTH, STEP)
    )
    assert np.isfinite(before).all()


def test_offsets_need_a_region_and_sweeps_that_leave_it() -> None:
    with pytest.raises(SceneError, match=r"scene everywhere: .* found no region"):
        SweepOffset(SCAN, Scene("everywhere", SCENE.axes, SCENE.phalanges, None, {}))
    with pytest.raises(SceneError, match=r"at least 3 sweeps that leave the feature's region .* found 2"):
        SweepOffset(scanned(OFFSETS[:2]), SCENE)
    assert knows_offsets(SCAN, SCENE)
    assert not knows_offsets(scanned(OFFSETS[:3]), SCENE), "one of three is to be held out"
