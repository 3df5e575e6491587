"""Strain that is none, or of other positions, is reported by its kind; good strain is not."""

import re

import numpy as np
import pytest

from tactile_localizer.streams.delay import Track
from tactile_localizer.streams.plausible_strain import describe_strain

RATE, STROKE_S = 100, 4
NAMES = ["index 1", "index 2", "index 3"]


def place_at(time_s):
    """Positions of strokes of 60 mm there and back in 3 s, with a second of rest behind each."""
    stroke, done = np.divmod(time_s, STROKE_S)
    way = 0.06 * np.clip(done / 3, 0, 1)
    return np.where(stroke % 2, 0.06 - way, way)


def strokes(count=6):
    """Time, position and strain (n, 3) of smooth features, with noise."""
    time_s = np.arange(count * STROKE_S * RATE) / RATE
    place, centres = place_at(time_s), np.array([0.01, 0.03, 0.05])
    noise = np.random.default_rng(0).normal(0.0, 1e-3, (len(time_s), 3))
    return time_s, place, 0.2 + np.exp(-0.5 * ((place[:, None] - centres) / 0.006) ** 2) + noise


def described(place, strain, part=STROKE_S * RATE):
    """What is reported of samples in sweeps of ``part`` samples."""
    stamp_ns = np.arange(len(place)) * (10**9 // RATE)
    cuts = range(0, len(place), part)
    rows = [slice(at, at + part) for at in cuts]
    return describe_strain([Track(stamp_ns[each], place[each, None], strain[each]) for each in rows], NAMES)


def saturated(strain):
    return np.minimum(strain, 0.8)


def without_value(strain):
    strain[::23, 1] = -9999.0
    return strain


def overflowing(strain):
    return (np.round(60_000 * strain) + 2**15) % 2**16 - 2**15


def of_two_sources(strain):
    strain[np.arange(len(strain)) // 10 % 2 == 0] += 2.0
    return strain


def stopped(strain):
    strain[1150:, 2] = strain[1150, 2]
    return strain


def held(strain):
    return strain[np.arange(len(strain)) // 10 * 10]


def in_millivolts(strain):
    strain[-2 * STROKE_S * RATE :] *= 1e3
    return strain


FAULTS = {
    saturated: "end of its range comes again and again.*index 1: 0.8 in",
    without_value: "end of its range comes again and again.*index 2: -9999 in 105 of 2400 samples$",
    overflowing: "jumps over half of its range",
    of_two_sources: "jumps over half of its range.*index 1 2[0-9]{2} times",
    stopped: "does not change, a sensor that stopped: index 3 for 1250 samples",
    held: "is held for 10 samples",
    in_millivolts: "of 2 of 6 sweeps has [0-9.e+]+ times the noise",
}


@pytest.mark.parametrize("spoil", FAULTS)
def test_strain_that_is_none_is_reported(spoil):
    _, place, strain = strokes()
    (found, *_) = described(place, spoil(strain))
    assert re.search(FAULTS[spoil], found)


def test_good_strain_is_not_reported():
    _, place, strain = strokes()
    assert described(place, strain) == []
    assert described(place, np.maximum(strain - 0.5, 0.0)) == [], "zero where nothing is felt"
    assert described(place, np.round(20 * strain)) == [], "few values"
    vibration = np.random.default_rng(1).normal(size=strain.shape) * strain
    assert described(place, vibration) == []
    assert described(place[:40], strain[:40]) == [], "too few samples"


def test_samples_that_are_missing_are_no_findings():
    _, place, strain = strokes()
    strain[::7, 1] = np.nan
    assert described(place, strain) == []
    assert described(place, np.full_like(strain, np.nan)) == []


@pytest.mark.parametrize(
    "place", [lambda t: place_at(np.maximum(t - 3, 0)), lambda t: place_at(np.minimum(t, 9))]
)
def test_strain_of_other_positions_is_reported_where_the_palm_rests(place):
    """Poses of a clock that is 3 s behind, and poses that stop."""
    time_s, _, strain = strokes()
    (found,) = described(place(time_s), strain, len(time_s))
    assert "strain changes while the palm rests as while it moves" in found
