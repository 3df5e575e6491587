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
    return simulate_scan("bump", seed=1).to_scan()


def changed(scan, column, values):
    strain = scan.strain.copy()
    strain[:, column] = values
    return replace(scan, strain=strain)


def appended(scan, states, strain):
    """The scan with one more sweep."""
    return replace(
        scan,
        states=np.concatenate([scan.states, states]),
        strain=np.concatenate([scan.strain, strain]),
        sweep=np.concatenate([scan.sweep, np.full(len(states), scan.sweep.max() + 1)]),
    )


@pytest.mark.parametrize("feature", ["bump", "snap", "grommet", "none"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_good_scan_has_no_findings(feature, seed):
    scan = simulate_scan(feature, seed=seed).to_scan()
    assert findings(scan, SCENE, []) == []
    margin = tuple(replace(axis, lower=-0.005, upper=0.0558) for axis in SCENE.axes)
    assert findings(scan, replace(SCENE, axes=margin), []) == []


def test_lines_in_order_over_a_sloping_sheet_are_no_finding(sound):
    slope = 20.0 * sound.states[:, [1]] * np.linspace(-1.0, 1.0, 16)
    assert findings(replace(sound, strain=sound.strain + slope), SCENE, []) == []


def test_ragged_ends_and_curved_sweeps_are_no_finding(sound):
    first = np.array([sound.states[sound.sweep == number, 0].min() for number in sound.sweep_numbers])
    ragged = first[sound.sweep - sound.sweep.min()] + 0.006 * (sound.sweep % 3)
    assert findings(sound.select(sound.states[:, 0] >= ragged), SCENE, []) == []
    turned = sound.states.copy()
    turned[:, 1] = 0.025 + (turned[:, 1] - 0.025) * np.cos(60.0 * turned[:, 0])
    assert findings(replace(sound, states=turned), SCENE, []) == []


@pytest.mark.parametrize("angle", [0.0, 0.5, np.pi / 2])
def test_a_missing_line_is_located(sound, angle):
    line = sound.states[sound.sweep == 9].mean(axis=0)
    scan = sound.select(sound.sweep != 9)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    bounds = tuple(replace(axis, lower=-0.06, upper=0.08) for axis in SCENE.axes)
    (finding, *_) = findings(replace(scan, states=scan.states @ turn.T), replace(SCENE, axes=bounds), [])[-1:]
    assert finding.startswith("uneven lines: 2.5 mm apart (median), but 5.4 mm between those around x ")
    places = [float(number) * 1e-3 for number in re.findall(r"[xy] (-?[\d.]+)", finding)]
    np.testing.assert_allclose(np.mean(np.reshape(places, (2, 2)), axis=0), turn @ line, atol=1e-3)


def test_a_dead_channel_is_reported(sound):
    (finding,) = findings(changed(sound, 10, 0.25), SCENE, [])
    assert finding == "middle channel 3: seems dead, all values lie within 0"


def test_a_saturated_channel_is_reported(sound):
    limit = float(np.round(np.quantile(sound.strain[:, 0], 0.97), 3))
    (finding,) = findings(changed(sound, 0, np.minimum(sound.strain[:, 0], limit)), SCENE, [])
    assert finding.startswith("index channel 1: seems saturated")
    assert finding.endswith(f"exactly {limit:.6g}")


def test_rest_and_coarse_counts_are_not_saturation(sound):
    rest = np.maximum(sound.strain[:, 0] - np.quantile(sound.strain[:, 0], 0.5), 0.0)
    assert findings(changed(sound, 0, rest), SCENE, []) == []
    assert findings(replace(sound, strain=np.round(sound.strain * 200) / 200), SCENE, []) == []


def test_a_sweep_that_ended_early_is_reported(sound):
    sweep = RecordedSweep(
        1, np.arange(100), np.zeros((100, 2)), np.zeros((100, 16)), np.zeros((100, 2)), ending="ended early"
    )
    found = findings(sound, SCENE, [sweep, replace(sweep, number=2, ending="ended")])
    assert found == ["sweep 1: its recording ended early, after 100 pairs"]


def test_few_pairs_have_no_findings_of_channels(sound):
    assert not any("channel " in line for line in findings(sound.select(np.array([0])), SCENE, []))


def test_bounds_far_beyond_the_scan_are_reported(sound):
    scene = Scene("line", (Axis("x", 0.0, 0.2),), (Phalanx("index", (0.0,)),))
    scan = Scan(sound.states[:, :1], sound.strain[:, :8], sound.sweep, ("x",), ("index",))
    (finding,) = findings(scan, scene, [])
    assert finding.startswith("coverage: only 2")


@pytest.mark.parametrize("part", [1, 2])
def test_a_sweep_that_is_a_copy_is_reported(sound, part):
    """Also where it is a part, and its numbers were rounded by another program."""
    rows = np.flatnonzero(sound.sweep == 5)
    rows = rows[: len(rows) // part]
    scan = appended(sound, np.round(sound.states[rows], 7), np.round(sound.strain[rows], 6))
    found = findings(scan, SCENE, [])
    assert found[-1].startswith(f"sweep {scan.sweep.max()}: differs from sweep 5 by ")
    assert "is it a copy? The noise learned from the scan is too small" in found[-1]


def test_a_line_that_is_scanned_twice_is_no_copy(sound):
    rows = np.flatnonzero(sound.sweep == 5)
    noise = np.diff(sound.strain[rows], n=2, axis=0).std() / np.sqrt(6)
    again = sound.strain[rows] + np.random.default_rng(0).normal(0, noise, (len(rows), 16))
    assert findings(appended(sound, sound.states[rows], again), SCENE, []) == []
