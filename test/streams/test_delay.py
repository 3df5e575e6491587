"""Strain that is late against the poses displaces strokes there and back."""

import numpy as np
import pytest

from tactile_localizer.scene import Axis
from tactile_localizer.streams.delay import Delay, Track, estimate_delay

LINE = (Axis("x", -1.0, 1.0),)
PLANE = (*LINE, Axis("y", -1.0, 1.0))
LENGTH, NOISE = 0.06, 0.05


def material(rng: np.random.Generator, slant: float = 0.0):
    """Strain of 6 channels at places (n, 2): smooth and random along x, displaced by ``slant`` times y."""
    places = rng.uniform(-0.02, LENGTH + 0.02, 40)
    weights = rng.normal(size=(40, 6))
    return lambda at: np.exp(-0.5 * ((at[:, :1] - slant * at[:, 1:] - places) / 0.002) ** 2) @ weights


def there_and_back(delay_s, seed, *, slant=0.0, strokes=10, speed=0.02, one_way=False, felt=None, wobble=0.3):
    """Tracks of strokes 2.5 mm apart at changing speed, a sample every 10 ms, whose strain is late."""
    rng = np.random.default_rng(seed)
    felt = felt or material(rng, slant)
    tracks, begin_s = [], 100.0
    for number in range(strokes):
        fine_s = np.arange(0.0, LENGTH / speed + 1.5, 0.001) - 0.75
        phase = rng.uniform(0.0, 2 * np.pi)
        pace = speed * (1.0 + wobble * np.sin(2 * fine_s + phase))
        x = np.cumsum(pace) * 0.001 - 0.75 * speed
        if number % 2 and not one_way:
            x = LENGTH - x
        time_s = np.arange(0.0, LENGTH / speed, 0.01)
        places = [
            np.column_stack([np.interp(at, fine_s, x), np.full(len(at), 0.0025 * number)])
            for at in (time_s, time_s - delay_s)
        ]
        strain = felt(places[1]) + rng.normal(0.0, NOISE, (len(time_s), 6)) + rng.normal(0.0, 0.2, 6)
        stamp_ns = np.rint(1e9 * (begin_s + time_s)).astype(int)
        tracks.append(Track(stamp_ns, places[0], strain))
        begin_s += LENGTH / speed + 1.0
    return tracks


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("delay_s", [0.02, 0.08, 0.24, 0.3, -0.1])
@pytest.mark.parametrize("speed", [0.02, 0.05])
def test_a_delay_of_strokes_there_and_back_is_found_within_5_ms(seed, delay_s, speed):
    found = estimate_delay(PLANE, there_and_back(delay_s, seed, speed=speed))
    assert found.seconds == pytest.approx(delay_s, abs=0.005)
    assert found.is_significant
    assert found.displacement == pytest.approx(2 * speed * abs(delay_s), rel=0.35)


@pytest.mark.parametrize("seed", range(6))
def test_no_delay_is_none(seed):
    found = estimate_delay(PLANE, there_and_back(0.0, seed))
    assert abs(found.seconds) < 0.005
    assert not found.is_significant


@pytest.mark.parametrize("slant", [-0.8, 0.5])
def test_slanted_lines_are_no_delay(slant):
    for delay_s in (0.0, 0.1):
        found = estimate_delay(PLANE, there_and_back(delay_s, 5, slant=slant))
        assert found.seconds == pytest.approx(delay_s, abs=0.006)
        assert found.is_significant == bool(delay_s)


@pytest.mark.parametrize("seed", range(2))
def test_featureless_material_shows_no_delay(seed):
    found = estimate_delay(PLANE, there_and_back(0.2, seed, felt=lambda at: np.zeros((len(at), 6))))
    assert not found.is_significant


def test_equal_teeth_show_no_single_delay():
    teeth = lambda at: np.sin(2 * np.pi * at[:, :1] / 0.003 + np.arange(6))  # noqa: E731
    found = estimate_delay(PLANE, there_and_back(0.1, 1, felt=teeth, wobble=0.0))
    assert not found.is_significant


def test_strokes_in_one_direction_hide_a_delay():
    assert estimate_delay(PLANE, there_and_back(0.2, 0, one_way=True)) is None
    assert estimate_delay(PLANE, there_and_back(0.2, 0, strokes=2)) is None
    assert estimate_delay(PLANE, []) is None


def test_one_track_may_have_all_strokes_on_one_line():
    tracks = there_and_back(0.15, 3)
    whole = Track(*(np.concatenate([getattr(each, name) for each in tracks]) for name in vars(tracks[0])))
    for axes, columns in ((PLANE, slice(0, 2)), (LINE, slice(0, 1))):
        track = Track(whole.stamp_ns, whole.position[:, columns], whole.strain)
        assert estimate_delay(axes, [track]).seconds == pytest.approx(0.15, abs=0.005)


def test_a_clock_that_drifts_is_no_delay_to_correct():
    tracks = [there_and_back(0.04 * number, 3)[number] for number in range(10)]
    found = estimate_delay(PLANE, tracks)
    assert found.is_likely
    assert not found.is_significant
    assert "may be late against the poses, or of a clock that drifts" in str(found)
    within_chance = Delay(0.03, 0.04, 0.0, is_significant=False)
    assert not within_chance.is_likely
    assert str(within_chance) == "strain is not late: 0.030 s (+-0.040 s)"
