"""Findings of the scan checks."""

import re

import numpy as np
import pytest

from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.io.scans.rows import SweepInfo
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


def changed(scan: Scan, strain: np.ndarray) -> Scan:
    return Scan(scan.states, strain, scan.sweep, scan.axes, scan.phalanges)


def info(number: int = 1, pairs: int = 100, gaps: int = 0, skipped: int = 0, ended=True, dropped=False):
    return SweepInfo(number, pairs, 0, 1, gaps, skipped, ended, dropped)


def the_finding(scan: Scan, sweeps=()) -> str:
    (finding,) = findings(scan, SCENE, list(sweeps))
    return finding


@pytest.mark.parametrize("feature", ["bump", "snap", "grommet"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_good_scan_has_no_findings(feature, seed):
    assert findings(simulate_scan(feature, seed=seed).to_scan(), SCENE, [info()]) == []


def test_a_missing_sweep_is_located(sound):
    line = sound.states[sound.sweep == 9, 1].mean()
    finding = the_finding(sound.select(sound.sweep != 9))
    assert finding.startswith("uneven spacing: sweeps are 2.4 mm apart")
    assert abs(float(re.search(r"y ([\d.]+)", finding)[1]) - 1e3 * line) < 0.5


def test_a_sweep_along_a_bound_is_reported(sound):
    inside = ((sound.states >= SCENE.lower) & (sound.states <= SCENE.upper)).all(axis=1)
    kept = sound.select(inside)
    sweeps = [
        info(int(n), int(np.sum(kept.sweep == n)), skipped=int(np.sum(~inside[sound.sweep == n])))
        for n in kept.sweep_numbers
    ]
    lines = [line for line in findings(kept, SCENE, sweeps) if "follows the bound" in line]
    assert [line.split(" of ")[0] for line in lines] == [
        f"sweep {one.number}: follows the bound y {bound}, {one.skipped}"
        for one, bound in ((sweeps[0], "0.0"), (sweeps[-1], "50.8"))
    ]


def test_millivolts_declared_as_volts_are_reported(sound):
    scan = changed(sound, 1000 * sound.strain)
    (finding,) = findings(scan, SCENE, [])
    assert finding.startswith("strain goes to ")
    assert "*0.001 for mV" in finding
    assert findings(scan, SCENE, [], "mV") == []


def test_jumps_within_a_sweep_are_reported(sound):
    joined = Scan(sound.states, sound.strain, np.zeros_like(sound.sweep), sound.axes, sound.phalanges)
    lines = findings(joined, SCENE, [])
    assert lines[0].startswith("only one sweep: ")
    assert re.match(r"sweep 0: the palm jumps by up to 5\d\.\d mm, 20 times", lines[1])


def test_gauges_are_not_checked_on_few_pairs(sound):
    (first, *others) = findings(sound.select(np.arange(3)), SCENE, [])
    assert first.startswith("only 3 pairs")
    assert not any("channel" in line for line in others)


def test_a_dead_gauge_is_reported(sound):
    strain = sound.strain.copy()
    strain[:, 10] = 0.25
    assert "middle channel 3: seems dead" in "\n".join(findings(changed(sound, strain), SCENE, []))


def test_a_saturated_gauge_is_reported(sound):
    strain = sound.strain.copy()
    limit = float(np.round(np.quantile(strain[:, 0], 0.97), 3))
    strain[:, 0] = np.minimum(strain[:, 0], limit)
    finding = the_finding(changed(sound, strain))
    assert finding.startswith("index channel 1: seems saturated")
    assert finding.endswith(f"exactly {limit:.6g}")


def test_a_gauge_at_rest_is_not_saturated(sound):
    strain = sound.strain.copy()
    strain[:, 0] = np.maximum(strain[:, 0] - np.quantile(strain[:, 0], 0.5), 0.0)
    assert not any("saturated" in finding for finding in findings(changed(sound, strain), SCENE, []))


def test_coarse_counts_are_not_saturated(sound):
    assert findings(changed(sound, np.round(sound.strain * 200) / 200), SCENE, []) == []


def test_a_deviating_sweep_is_reported(sound):
    strain = sound.strain.copy()
    strain[sound.sweep == 5] = np.roll(strain[sound.sweep == 5], 300, axis=0) + 0.1
    assert any(
        "sweep 5: differs from the sweeps around it" in line
        for line in findings(changed(sound, strain), SCENE, [])
    )


def test_drift_is_reported(sound):
    strain = sound.strain.copy()
    strain[:, 3] += 0.3 * sound.sweep / sound.sweep.max()
    assert the_finding(changed(sound, strain)).startswith("index channel 4: drifts by +0.299 over the scan")


def test_lost_samples_are_reported_by_sweep(sound):
    sweeps = [
        info(1, ended=False),
        info(2, gaps=20),
        info(3, skipped=20),
        info(4, gaps=2),
        info(5, 0, 9, dropped=True),
    ]
    assert findings(sound, SCENE, sweeps) == [
        "sweep 1: its recording ended early, after 100 pairs",
        "sweep 2: 20 of 120 samples fell into gaps of the palm poses",
        "sweep 3: 20 of 120 samples were missing, saturated or out of bounds",
    ]


def test_an_unfinished_line_is_reported(sound):
    scene = Scene("line", (Axis("x", 0.0, 0.2),), SCENE.phalanges[:1] and (Phalanx("index", (0.0,)),))
    scan = Scan(sound.states[:, :1], sound.strain[:, :8], sound.sweep, ("x",), ("index",))
    assert any(line.startswith("coverage: only 2") for line in findings(scan, scene, []))


def test_a_scan_of_one_pair_is_checked(sound):
    findings(sound.select(np.array([0])), SCENE, [info()])
