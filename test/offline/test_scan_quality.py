"""Findings of the scan checks: what is wrong is found, and what is not wrong is not."""

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


def joined(scan, states, strain, sweep):
    """The scan with further pairs."""
    return replace(
        scan,
        states=np.concatenate([scan.states, states]),
        strain=np.concatenate([scan.strain, strain]),
        sweep=np.concatenate([scan.sweep, sweep]),
    )


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
    sweep = RecordedSweep(1, *[np.zeros(100)] * 4, ending="ended early")
    found = findings(sound, SCENE, [sweep, replace(sweep, number=2, ending="ended")])
    assert found == ["recording ended early: sweep 1"]


def test_few_pairs_have_no_findings_of_channels(sound):
    assert not any("channel " in line for line in findings(sound.select(np.array([0])), SCENE, []))


def test_bounds_far_beyond_the_scan_are_reported(sound):
    scene = Scene("line", (Axis("x", 0.0, 0.2),), (Phalanx("index", (0.0,)),))
    scan = Scan(sound.states[:, :1], sound.strain[:, :8], sound.sweep, ("x",), ("index",))
    (finding,) = findings(scan, scene, [])
    assert finding.startswith("coverage: only 2")


@pytest.mark.parametrize("part", [1, 2])
def test_copies_are_reported_in_one_line(sound, part):
    """Also where they are a part, and their numbers were rounded by another program."""
    copies, added = sound.select(np.arange(len(sound) // part)), sound.sweep.max() + 1
    copied = np.round(copies.states, 7), np.round(copies.strain, 6), copies.sweep + added
    (finding,) = findings(joined(sound, *copied), SCENE, [])
    first, more = sound.sweep.min(), len(copies.sweep_numbers) - 10
    assert finding.startswith(f"sweeps that seem to be copies: {first} and {first + added}, ")
    assert finding.endswith(f" and {more} more; the noise learned from them is too small")


def test_a_line_that_is_scanned_twice_is_no_copy(sound):
    rows = np.flatnonzero(sound.sweep == 5)
    noise = np.diff(sound.strain[rows], n=2, axis=0).std() / np.sqrt(6)
    again = sound.strain[rows] + np.random.default_rng(0).normal(0, noise, (len(rows), 16))
    twice = joined(sound, sound.states[rows], again, np.full(len(rows), sound.sweep.max() + 1))
    assert findings(twice, SCENE, []) == []
