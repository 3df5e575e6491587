"""The localizer: strains and palm positions in, an estimate out, by travelled distance."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.scans import bump_scan, line_scan, scene, strain_at

from tactile_localizer.core.calibration.calibration import Calibration
from tactile_localizer.core.calibration.examination import Examination
from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.core.hypotheses.explanations import RELOCATION_DISTANCE
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.errors import MeasurementError

OF = scene()
SCAN = line_scan(np.random.default_rng(0), OF)
CALIBRATION = Calibration(np.full(2, 4e-4), examination=Examination(0.0017, 0.0017))
"""Given, so that no test waits for it to be learned."""
ON_SHEET = CALIBRATION._replace(material=Material.SHEET)
ANYWHERE = np.array([3.0, -2.0])
"""Where the arm's frame has its origin, seen from the material."""


def build(scan=SCAN, calibration=CALIBRATION, **choices):
    return build_localizer(
        scan, OF, Configuration(**choices), np.random.default_rng(1), calibration=calibration
    )


@pytest.fixture(scope="module", params=["grid", "particle"])
def built(request):
    return build(filter=request.param)


@pytest.fixture
def localizer(built):
    built.reset()
    return built


def slide(localizer, start=(0.01, 0.02), steps=60, step=(0.0006, 0.0002), first_ns=0, anywhere=ANYWHERE):
    """Truth and estimates along a straight way."""
    for n in range(steps):
        truth = np.array(start) + n * np.array(step)
        position, strain = truth + anywhere, strain_at(truth[None])[0]
        position.flags.writeable = strain.flags.writeable = False  # the caller's arrays are not changed
        yield truth, localizer.update(first_ns + n * 10_000_000, position, strain)


def state_of(localizer):
    """All that could change in a belief."""
    states, weights = localizer.hypotheses()
    return states.copy(), weights.copy()


def unchanged(localizer, before):
    return all(np.array_equal(a, b) for a, b in zip(state_of(localizer), before, strict=True))


def test_it_finds_where_the_palm_is_whatever_the_arms_frame(localizer):
    truth, estimate = list(slide(localizer))[-1]
    assert np.linalg.norm(estimate.mean - truth) < 0.001
    assert estimate.converged, estimate.reason
    assert estimate.trace == pytest.approx(np.trace(estimate.covariance))
    assert estimate.travel == pytest.approx(59 * math.hypot(0.0006, 0.0002))


def test_a_fast_hand_is_updated_at_most_every_8_ms_and_moved_along_between(localizer):
    """At 1 kHz and 0.5 m/s every strain is an update distance further on."""
    estimates = []
    for n in range(60):
        truth = np.array([0.01, 0.02]) + n * np.array([0.0005, 0.0])
        strain = strain_at(truth[None])[0]
        estimates.append((truth, localizer.update(n * 1_000_000, truth + ANYWHERE, strain)))
    updated = [n for n, (_, estimate) in enumerate(estimates) if estimate.updated]
    assert updated == list(range(0, 60, 8))
    truth, estimate = estimates[-1]
    # Eight updates leave a particle filter up to 3 mm off, depending on its seed, and it says so.
    assert np.linalg.norm(estimate.mean - truth) < 3.0 * math.sqrt(estimate.trace)
    assert estimate.travel == pytest.approx(59 * 0.0005)


def test_a_hand_at_rest_learns_nothing_from_an_arm_that_trembles(localizer):
    """Encoder noise of 10 um a sample is no travel: it does not add up."""
    list(slide(localizer, steps=10))
    before = state_of(localizer)
    place, rng = np.array([0.0154, 0.0218]), np.random.default_rng(0)
    for n in range(500):
        trembling = place + 1e-5 * rng.standard_normal(2)
        estimate = localizer.update(10**9 + n, trembling + ANYWHERE, strain_at(place[None])[0])
        assert not estimate.updated
    assert unchanged(localizer, before)


def test_between_updates_the_estimate_moves_along_and_widens(localizer):
    *_, (_, updated) = slide(localizer, steps=10)
    place = np.array([0.010, 0.020]) + 9 * np.array([0.0006, 0.0002]) + [0.0002, 0.0]
    moved = localizer.update(10**9, place + ANYWHERE, strain_at(place[None])[0])
    assert not moved.updated
    np.testing.assert_allclose(moved.mean - updated.mean, [0.0002, 0.0], atol=1e-9)
    assert moved.trace > updated.trace


def test_the_same_way_in_smaller_steps_gives_the_same_answer_with_the_grid():
    coarse, fine = build(), build()
    *_, (_, one) = slide(coarse, steps=40, step=(0.0006, 0.0))
    *_, (_, other) = slide(fine, steps=391, step=(0.00006, 0.0))
    np.testing.assert_allclose(one.mean, other.mean, atol=5e-4)
    np.testing.assert_allclose(np.sqrt(np.diag(one.covariance)), np.sqrt(np.diag(other.covariance)), rtol=0.2)


BAD = [np.nan, np.inf, -np.inf]


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("what", ["position", "strain"])
def test_what_is_not_finite_is_refused_and_the_belief_untouched(localizer, bad, what):
    list(slide(localizer, steps=10))
    before = state_of(localizer)
    position, strain = np.array([0.02, 0.02]) + ANYWHERE, np.zeros(16)
    {"position": position, "strain": strain}[what][1] = bad
    with pytest.raises(MeasurementError, match=what):
        localizer.update(10**9, position, strain)
    assert unchanged(localizer, before)
    # It goes on as if the sample had not been there.
    *_, (truth, estimate) = slide(localizer, (0.016, 0.022), 30, first_ns=2 * 10**9)
    assert np.linalg.norm(estimate.mean - truth) < 0.002


def test_stamps_that_jump_back_start_anew(localizer):
    list(slide(localizer, first_ns=10**12))
    estimate = localizer.update(0, ANYWHERE, strain_at(np.zeros((1, 2)))[0])
    assert estimate.travel == 0.0
    assert not estimate.converged


@pytest.mark.parametrize("distance", [0.2, 1.0, 1e3, 1e9])
def test_after_jumps_of_the_arm_beyond_the_scene_the_palm_is_found(localizer, distance):
    list(slide(localizer, steps=10))
    for stamp_ns, place in ((10**9, distance), (2 * 10**9, -distance)):
        estimate = localizer.update(stamp_ns, ANYWHERE + place, np.zeros(16))
        assert np.isfinite(estimate.mean).all()
        assert np.isfinite(estimate.covariance).all()
        assert not estimate.converged
    *_, (truth, estimate) = slide(localizer, first_ns=3 * 10**9)
    assert np.linalg.norm(estimate.mean - truth) < 0.002


def test_a_caller_may_fill_one_buffer_with_every_strain(localizer):
    """A phalanx that is stuck is found by what the last strain was, not by what its array holds now."""
    strain, rng = np.zeros(16), np.random.default_rng(0)
    for n in range(10):
        strain[8:] = rng.normal(0.0, 0.01, 8)
        estimate = localizer.update(n * 10_000_000, np.array([0.01 + 0.001 * n, 0.02]), strain)
    assert estimate.consistent.tolist() == [False, True]


@pytest.mark.parametrize("apart", [1, 2])
def test_a_buffer_with_every_strain_gives_what_separate_strains_give(apart):
    """Noise and spikes are those of the differences from the strains before, in whatever array."""
    rng, buffer, of, other = np.random.default_rng(0), np.zeros(16 * apart)[::apart], build(), build()
    way = [(n, np.array([0.01 + 0.0004 * n, 0.02])) for n in range(40)]
    for n, position in way:
        buffer[:] = strain_at(position[None])[0] + rng.normal(0.0, 0.05, 16)
        if n == 20:
            buffer[3] += 1e3
        found, expected = (
            each.update(n * 10_000_000, position, strain)
            for each, strain in ((of, buffer), (other, buffer.copy()))
        )
        np.testing.assert_array_equal(found.mean, expected.mean)
    assert of.spikes == other.spikes == {"index_4": 1}


def test_a_hand_put_down_elsewhere_is_soon_converged_there_and_not_before(localizer):
    """What speaks for the place that it left speaks neither for nor against the other one."""
    *_, (end, estimate) = slide(localizer)
    assert estimate.converged
    start, back, tracked = np.array([0.046, 0.012]), (-0.0006, 0.0001), []
    for truth, estimate in slide(localizer, start, 60, back, 10**9, end - start + ANYWHERE):
        tracked.append(localizer.explanations.tracked)
        assert estimate.probability <= tracked[-1] + 1e-6
        error = np.linalg.norm(estimate.mean - truth)
    assert min(tracked) < 0.9
    assert estimate.converged, estimate.reason
    assert error < 0.002


def test_a_hand_near_the_estimate_is_tracked_and_not_relocated():
    localizer = build()
    *_, (_, estimate) = slide(localizer)
    near = np.linalg.norm(localizer._anchors.states - estimate.mean, axis=1) < 0.8 * RELOCATION_DISTANCE
    assert near.sum() > 10
    assert not localizer.explanations.anchor_weights[near].any()


def test_a_strain_is_worth_less_the_longer_the_information_length():
    """All strains of a sweep share errors of the map."""
    spread = []
    for length in (0.0005, 0.005, 0.05):
        *_, (_, estimate) = slide(
            build(calibration=Calibration(np.full(2, 4e-4), examination=Examination(length, length)))
        )
        spread.append(estimate.trace)
    assert spread == sorted(spread)
    assert spread[-1] > 2.0 * spread[0]


@pytest.mark.parametrize("std", [4e-4, 0.005])
def test_the_flag_includes_the_registration_error(std):
    """A sure belief is within r of the truth with 1 - exp(-r^2 / 2 s^2), however narrow it is."""
    *_, (_, estimate) = slide(build(calibration=CALIBRATION._replace(registration_std=np.full(2, std))))
    near = 1.0 - math.exp(-0.5 * (Configuration().convergence_radius / std) ** 2)
    assert estimate.probability / estimate.on_map == pytest.approx(near, abs=0.02)
    assert estimate.converged == (near > Configuration().convergence_probability)


def test_a_sure_belief_has_the_likelihood_of_its_place_whatever_the_tempering():
    found, corner = [], np.array([0.004, 0.045])
    for update_distance in (0.0005, 0.005):
        localizer = build(bump_scan(OF), ON_SHEET, update_distance=update_distance)
        localizer.seed(corner, np.full(2, 1e-4))
        estimate = localizer.update(0, corner, np.full(16, 0.7))
        found.append(estimate.log_marginal)
        odds = localizer.explanations.other / localizer.explanations.tracked
        exponent = min(1.0, update_distance / 0.0017)  # of an independent measurement
        assert math.log(odds) == pytest.approx(exponent * (estimate.log_other - found[-1]), abs=1e-6)
    assert found[0] == pytest.approx(found[1], rel=0.05)


def test_a_wrong_belief_recovers(localizer):
    """The grid to the right place; particles near it, most of them within a kernel's width."""
    errors = []
    for _ in range(1 if "Grid" in type(localizer.filter).__name__ else 9):
        localizer.seed(np.array([0.04, 0.045]), np.array([0.0005, 0.0005]))
        *_, (truth, estimate) = slide(localizer, steps=60)
        errors.append(np.linalg.norm(estimate.mean - truth))
    assert np.median(errors) < 0.002
    assert max(errors) < 0.01


@given(
    moves=st.lists(
        st.tuples(
            st.floats(-0.02, 0.02) | st.sampled_from([0.2, -1e3, 1e9]),
            st.floats(-0.02, 0.02),
            st.floats(-1e3, 1e3) | st.just(math.nan),
            st.integers(-1, 5).map(lambda steps: 10_000_000 * steps + 5_000_000),
        ),
        max_size=40,
    )
)
def test_whatever_comes_an_estimate_is_finite_and_its_covariance_is_one(built, moves):
    built.reset()
    position, stamp = np.zeros(2), 0
    for x, y, volts, later in moves:
        position, stamp = position + np.array([x, y]), stamp + later
        try:
            estimate = built.update(stamp, position, np.full(16, volts))
        except MeasurementError:
            assert math.isnan(volts)
            continue
        assert np.isfinite(estimate.mean).all()
        assert np.linalg.eigvalsh(estimate.covariance).min() > 0
        assert 0.0 <= estimate.probability <= estimate.on_map + 1e-12 <= 1.0 + 2e-12
        assert built.hypotheses()[1].sum() == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("mean", "std", "what"),
    [
        (np.array([0.01, math.nan]), np.full(2, 0.001), "mean: expected 2 finite numbers"),
        (np.full(2, 0.01), np.array([math.inf, 0.1]), "std: expected 2 finite numbers"),
        (np.full(3, 0.01), np.full(3, 0.001), "mean: expected 2 finite numbers"),
        (np.full(2, 0.01), np.array([-0.001, 0.1]), "std: expected no negative deviation"),
    ],
)
def test_a_seed_that_is_no_place_is_refused_and_the_belief_untouched(localizer, mean, std, what):
    list(slide(localizer, steps=5))
    before = state_of(localizer)
    with pytest.raises(MeasurementError, match=what):
        localizer.seed(mean, std)
    assert unchanged(localizer, before)


@pytest.mark.parametrize("factor", [1000.0, 0.001])
def test_strains_in_another_unit_never_converge(factor):
    localizer = build(bump_scan(OF, offsets=1.0), ON_SHEET)
    along = np.arange(0.004, 0.046, 0.0005)
    for stamp, x in enumerate(along):
        place = np.array([x, 0.0251])
        bump = 30.0 * math.exp(-0.5 * ((x - 0.025) ** 2 + 1e-8) / 0.004**2)
        strain = 5.0 + bump * np.linspace(-1.0, 1.0, 16)
        estimate = localizer.update(10_000_000 * stamp, place, factor * strain)
        assert not estimate.converged
    if abs(factor) > 1.0:
        assert "outside the range of the scan" in estimate.reason


def test_a_spike_as_the_first_strain_is_one_strain_of_those_out_of_range():
    localizer = build()
    for n, place in enumerate(np.linspace([0.01, 0.02], [0.016, 0.022], 10)):
        localizer.update(10_000_000 * n, place, strain_at(place[None])[0] + 1e3 * (n == 0))
        assert localizer.out_of_range == pytest.approx(1.0 / (1 + n))


def test_a_gauge_that_stands_still_is_named_and_the_others_count():
    localizer, rng = build(), np.random.default_rng(0)
    for n in range(60):
        truth = np.array([0.01, 0.02]) + n * np.array([0.0006, 0.0002])
        strain = strain_at(truth[None])[0] + 0.02 * rng.standard_normal(16)
        strain[2] = 0.05
        estimate = localizer.update(10_000_000 * n, truth, strain)
    assert estimate.consistent.tolist() == [False, True]
    assert estimate.reason.endswith("; index_3 stands still")
    assert np.linalg.norm(estimate.mean - truth) < 0.002
