"""Findings of the scan checks: what is wrong is found, and what is not wrong is not."""

import re
from dataclasses import replace

import numpy as np
import pytest

from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.io.recording import RecordedSweep
from tactile_localizer.offline.scan_quality import findings
from tactile_localizer.scene import Axis, Phalanx, Scene
from tactile_localizer.sim import simulate_scan

SCENE = Scene(
    "bump",
    (Axis("x", 0.0, 0.0508), Axis("y", 0.0, 0.0508)),
    (Phalanx("index", (0.0, 0.012)), Phalanx("middle", (0.0, -0.012))),
)


@pytest.fixture(scope="module")
def sound():
    return simulate_scan("bump", seed=1)


@pytest.mark.parametrize(("feature", "seed"), [("bump", 1), ("snap", 2), ("grommet", 3), ("none", 4)])
def test_a_good_scan_has_no_findings(feature, seed):
    scan = simulate_scan(feature, seed=seed)
    assert findings(scan, SCENE, []) == []
    margin = tuple(replace(axis, lower=-0.005, upper=0.0558) for axis in SCENE.axes)
    assert findings(scan, replace(SCENE, axes=margin), []) == []


def test_dead_channels_are_reported_in_one_line(sound):
    strain = sound.strain.copy()
    strain[:, [2, 10]] = 0.25 + 1e-4 * (np.arange(len(strain)) % 2)[:, None]  # the last bit of a converter
    (finding,) = findings(replace(sound, strain=strain), SCENE, [])
    assert finding == "channels that seem dead, of nearly constant strain: index 3, middle 3"


def test_a_sweep_that_ended_early_is_reported(sound):
    sweep = RecordedSweep(
        1, np.zeros(100), np.zeros((100, 2)), *[np.zeros((100, 16))] * 2, ending="ended early"
    )
    found = findings(sound, SCENE, [sweep, replace(sweep, number=2, ending="ended")])
    assert found == ["recording ended early: sweep 1"]


def test_strain_of_two_sources_is_reported(sound):
    rng = np.random.default_rng(0)
    stamp_ns, x = np.arange(200) * 10_000_000, np.linspace(0.0, 0.05, 200)
    place, signal = np.column_stack([x, x]), np.sin(100 * x)[:, None] * np.ones(16)
    felt = signal + 0.05 * rng.standard_normal(signal.shape)
    other = felt + 0.5 * (np.arange(200) % 2)[:, None]
    sweeps = [RecordedSweep(n, stamp_ns, place, each, x) for n, each in enumerate((felt, other, signal), 1)]
    assert findings(sound, SCENE, sweeps) == [
        "strain that alternates from sample to sample, of two sources: sweep 2"
    ]


def test_implausible_motion_is_reported_once(sound):
    stamp_ns, x = np.arange(0, 400) * 5_000_000, np.linspace(0.0, 0.05, 400)
    moving, two = (np.column_stack([x + off, x]) for off in (0.0, 0.01 * (np.arange(400) % 2)))
    places = [moving, moving[:1] + 0 * moving, two, moving, two]
    sweeps = [
        RecordedSweep(n, stamp_ns, place, x[:, None] * np.ones(16), x) for n, place in enumerate(places, 1)
    ]
    (finding,) = findings(sound, SCENE, sweeps)
    assert finding == "the position does not change over 2.0 s (sweep 2, and 2 of 4 others are implausible)"


def test_few_pairs_have_no_findings_of_channels(sound):
    assert not any("channel " in line for line in findings(sound.select(np.array([0])), SCENE, []))


@pytest.mark.parametrize(
    ("upper", "expected"), [(0.2, "coverage: only 2.*pair$"), (50.8, r"coverage: .*pair \(bounds in mm\?\)$")]
)
def test_bounds_far_beyond_the_scan_are_reported(sound, upper, expected):
    scene = Scene("line", (Axis("x", 0.0, upper),), (Phalanx("index", (0.0,)),))
    scan = Scan(sound.states[:, :1], sound.strain[:, :8], sound.sweep, ("x",), ("index",))
    (finding,) = findings(scan, scene, [])
    assert re.match(expected, finding)
