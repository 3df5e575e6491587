"""Measurements of a sweep, by travelled distance and before anything is known of the position."""

from __future__ import annotations

import numpy as np
import pytest
from support.models import noise_model

from tactile_localizer.core.likelihood.gain import RECENT
from tactile_localizer.core.measurements import UPDATE_PERIOD_NS, Measurement, Measurements
from tactile_localizer.core.scan.range import ScanRange
from tactile_localizer.errors import MeasurementError
from tactile_localizer.scene import Axis, Phalanx, Scene

LINE = Scene("line", (Axis("x", 0.0, 0.1),), (Phalanx("index", (0.0,), 2), Phalanx("thumb", (0.0,), 2)))
DISTANCE, WIDTH = 0.001, 2.0
BOTH = np.ones(2, dtype=bool)
NOISE = np.random.default_rng(0).standard_normal((1000, 4))


def measurements(still: float = np.inf) -> Measurements:
    """Of a scan with strains of 10 V at most and noise of 2 V."""
    noise = noise_model(LINE.layout, WIDTH)
    wide = ScanRange(LINE.layout, np.full(4, -10.0), np.full(4, 10.0), np.ones(1), np.zeros(4))
    return Measurements(LINE, noise.white, noise.variance, wide, np.full(4, still), DISTANCE)


def fed(
    to: Measurements,
    x: np.ndarray,
    strains: np.ndarray = NOISE,
    present: np.ndarray = BOTH,
    period_ns: int = 20_000_000,
) -> list[Measurement | None]:
    """What comes of strains at positions x (n,), m."""
    return [
        to.observe((1 + n) * period_ns, np.array([place]), strain, present)
        for n, (place, strain) in enumerate(zip(x, strains, strict=False))
    ]


def rows(found: list[Measurement | None]) -> list[int]:
    """Which strains led to a measurement."""
    return [row for row, each in enumerate(found) if each is not None]


@pytest.mark.parametrize("steps", [1, 4, 10])
def test_the_first_strain_is_a_measurement_and_then_those_of_each_update_distance(steps: int) -> None:
    """Wherever the origin of the arm's frame is."""
    for origin in (0.0, -3.0, 1e4):
        found = fed(measurements(), origin + DISTANCE / steps * np.arange(5 * steps + 1))
        assert rows(found) == list(range(0, 5 * steps + 1, steps))


def test_a_measurement_is_the_mean_of_its_strains_at_their_mean_position() -> None:
    x = 0.02 + np.arange(0.0, 0.01, 0.0002)
    slope = np.array([100.0, -50.0, 20.0, 10.0])
    place = x[0]
    for row, each in enumerate(fed(measurements(), x, np.outer(x, slope))):
        if each is not None:
            place = place + each.displacement[0]
            np.testing.assert_allclose(each.strain, place * slope)
            np.testing.assert_allclose(place + each.pending, x[row])
            assert each.travel == pytest.approx(abs(each.displacement[0]))


def test_between_measurements_what_is_pending_grows() -> None:
    of = measurements()
    fed(of, np.array([0.02, 0.0203, 0.0206]))
    np.testing.assert_allclose(of.pending, 0.0006)


@pytest.mark.parametrize("period_ns", [1_000_000, 3_000_000, UPDATE_PERIOD_NS, 20_000_000])
def test_a_fast_hand_is_not_measured_more_often_than_its_period(period_ns: int) -> None:
    found = rows(fed(measurements(), DISTANCE * np.arange(40), period_ns=period_ns))
    apart = -(-UPDATE_PERIOD_NS // period_ns)
    assert found == list(range(0, 40, apart))


def test_a_hand_at_rest_is_measured_once() -> None:
    trembling = 0.02 + 1e-5 * np.random.default_rng(1).standard_normal(500)
    assert rows(fed(measurements(), trembling)) == [0]


def test_after_a_reset_a_sweep_begins() -> None:
    of, x = measurements(), DISTANCE * np.arange(30)
    strains = np.where(np.arange(30)[:, None] < 20, NOISE[:30], 100.0)
    first = fed(of, x, strains)
    assert of.outside > 0.0
    assert of.goes_back(0, np.zeros(1))
    of.reset()
    assert of.outside == 0.0
    assert not of.goes_back(0, np.zeros(1))
    for one, other in zip(fed(of, 0.05 + x, strains), first, strict=True):
        assert one is not None
        assert other is not None
        for value, before in zip(one, other, strict=True):
            np.testing.assert_allclose(value, before, atol=1e-12)


def test_the_fraction_outside_the_range_is_a_mean_at_first_and_fades_over_what_is_recent() -> None:
    of, x = measurements(), DISTANCE * np.arange(200)
    strains = NOISE[:200] + 100.0 * (np.arange(200)[:, None] == 0)
    found = [each.outside for each in fed(of, x, strains) if each is not None]
    recent = round(RECENT / DISTANCE)
    np.testing.assert_allclose(found[:recent], 1.0 / np.arange(1, recent + 1))
    fading = (1.0 - 1.0 / recent) ** np.arange(1, 21)
    np.testing.assert_allclose(found[recent:][:20], found[recent - 1] * fading)


def test_noise_beyond_that_of_the_scan_is_in_the_excess() -> None:
    plain, noisy = (
        fed(measurements(), DISTANCE * np.arange(400), WIDTH * factor * NOISE)[-1].excess.diagonal()
        for factor in (np.ones(4), np.array([1.0, 1.0, 5.0, 1.0]))
    )
    assert plain.max() < 0.5 * WIDTH**2
    assert noisy[2] == pytest.approx(24.0 * WIDTH**2, rel=0.4)
    assert np.delete(noisy, 2).max() < 0.5 * WIDTH**2


def test_what_is_absent_or_stands_still_is_all_noise() -> None:
    """A phalanx counts by those of its channels that are left."""
    x, strains = DISTANCE * np.arange(20), WIDTH * NOISE[:20]
    strains[:, 1] = 0.5
    of = measurements(still=0.0)
    stuck = fed(of, x, strains)[-1]
    assert of.stuck.tolist() == [False, True, False, False]
    assert stuck.used.tolist() == [True, True]
    assert (stuck.excess.diagonal() > 1e6 * WIDTH**2).tolist() == [False, True, False, False]
    absent = fed(measurements(), x, NOISE, np.array([False, True]))[-1]
    assert absent.used.tolist() == [False, True]
    assert (absent.excess.diagonal() > 1e6 * WIDTH**2).tolist() == [True, True, False, False]


def test_stamps_in_another_unit_are_refused_and_those_that_go_back_are_noticed() -> None:
    of = measurements()
    assert not of.goes_back(20_000_000, np.zeros(1))
    fed(of, DISTANCE * np.arange(5))
    assert not of.goes_back(100_000_000, np.array([0.004]))
    assert of.goes_back(99_999_999, np.array([0.004]))

    def travel_while_stamps_stand() -> None:
        for row in range(100):
            of.goes_back(100_000_000 + row, np.array([0.004 + 0.001 * row]))

    with pytest.raises(MeasurementError, match="expected ns"):
        travel_while_stamps_stand()


@pytest.mark.parametrize(
    ("step", "gap", "lifted"),
    [(2.0 * DISTANCE, False, False), (0.9 * RECENT, True, False), (1.1 * RECENT, True, True)],
)
def test_after_a_gap_what_was_felt_before_predicts_nothing(step: float, gap: bool, lifted: bool) -> None:
    """So the first strain after it is no spike, and after a long one the hand was lifted and set down."""
    to = measurements()
    x = np.arange(40) * DISTANCE
    x[20:] += step
    strains = 0.1 * NOISE[:40]
    strains[20:] += 300.0 * WIDTH
    found = [each for each in fed(to, x, strains) if each is not None]
    assert [each.set_down for each in found] == [lifted and row == 20 for row in range(40)]
    assert (found[20].strain[0] > 100.0 * WIDTH) == gap


def test_a_hand_that_slides_fast_over_a_slow_sensor_is_not_lifted() -> None:
    found = [each for each in fed(measurements(), 1.5 * RECENT * np.arange(40)) if each is not None]
    assert not any(each.set_down for each in found)
