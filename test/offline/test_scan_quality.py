"""A scan's faults are found, one line each, and a sound scan has none."""

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
def test_a_sound_scan_has_nothing_to_mend(feature, seed):
    assert findings(simulate_scan(feature, seed=seed).to_scan(), SCENE, [info()]) == []


def test_a_sweep_that_is_missing_is_found_by_its_place(sound):
    line = sound.states[sound.sweep == 9, 1].mean()
    finding = the_finding(sound.select(sound.sweep != 9))
    assert finding.startswith("uneven spacing: sweeps are 2.4 mm apart")
    assert abs(float(re.search(r"y ([\d.]+)", finding)[1]) - 1e3 * line) < 0.5


def test_a_sweep_that_wobbles_over_a_bound_is_named_with_what_it_lost(sound):
    inside = ((sound.states >= SCENE.lower) & (sound.states <= SCENE.upper)).all(axis=1)
    kept = sound.select(inside)
    sweeps = [
        info(int(n), int(np.sum(kept.sweep == n)), skipped=int(np.sum(~inside[sound.sweep == n])))
        for n in kept.sweep_numbers
    ]
    lines = [line for line in findings(kept, SCENE, sweeps) if "lies on the bound" in line]
    assert [line.split(" of ")[0] for line in lines] == [
        f"sweep {one.number}: lies on the bound y {bound}, {one.skipped}"
        for one, bound in ((sweeps[0], "0.0"), (sweeps[-1], "50.8"))
    ]


def test_millivolts_taken_for_volts_are_told_unless_the_unit_says_so(sound):
    scan = changed(sound, 1000 * sound.strain)
    (finding,) = findings(scan, SCENE, [])
    assert finding.startswith("strain goes to ")
    assert "*0.001 for mV" in finding
    assert findings(scan, SCENE, [], "mV") == []


def test_several_sweeps_that_count_as_one_are_told_by_the_leaps_between_them(sound):
    joined = Scan(sound.states, sound.strain, np.zeros_like(sound.sweep), sound.axes, sound.phalanges)
    lines = findings(joined, SCENE, [])
    assert lines[0].startswith("only one sweep: ")
    assert re.match(r"sweep 0: the palm leaps by 5\d\.\d mm, 20 in all", lines[1])


def test_of_a_few_pairs_nothing_is_said_of_the_gauges(sound):
    (first, *others) = findings(sound.select(np.arange(3)), SCENE, [])
    assert first == "only 3 pairs: too few to judge the gauges"
    assert not any("element" in line for line in others)


def test_a_dead_gauge_is_named(sound):
    strain = sound.strain.copy()
    strain[:, 10] = 0.25
    assert "middle element 3: seems dead" in "\n".join(findings(changed(sound, strain), SCENE, []))


def test_a_saturated_gauge_is_named_with_its_limit(sound):
    strain = sound.strain.copy()
    limit = float(np.round(np.quantile(strain[:, 0], 0.97), 3))
    strain[:, 0] = np.minimum(strain[:, 0], limit)
    finding = the_finding(changed(sound, strain))
    assert finding.startswith("index element 1: seems saturated")
    assert finding.endswith(f"exactly {limit:.6g}")


def test_a_sensor_that_rests_at_zero_is_not_taken_for_saturated(sound):
    strain = sound.strain.copy()
    strain[:, 0] = np.maximum(strain[:, 0] - np.quantile(strain[:, 0], 0.5), 0.0)
    assert not any("saturated" in finding for finding in findings(changed(sound, strain), SCENE, []))


def test_coarse_counts_are_not_taken_for_saturation(sound):
    assert findings(changed(sound, np.round(sound.strain * 200) / 200), SCENE, []) == []


def test_a_sweep_that_disagrees_with_those_around_it_is_named(sound):
    strain = sound.strain.copy()
    strain[sound.sweep == 5] = np.roll(strain[sound.sweep == 5], 300, axis=0) + 0.1
    assert any(
        "sweep 5: differs from the sweeps around it" in line
        for line in findings(changed(sound, strain), SCENE, [])
    )


def test_drift_over_the_scan_is_named_with_its_size(sound):
    strain = sound.strain.copy()
    strain[:, 3] += 0.3 * sound.sweep / sound.sweep.max()
    assert the_finding(changed(sound, strain)).startswith("index element 4: drifts by +0.299 over the scan")


def test_what_the_recorder_lost_is_told_by_sweep(sound):
    sweeps = [
        info(1, ended=False),
        info(2, gaps=20),
        info(3, skipped=20),
        info(4, gaps=2),
        info(5, 0, 9, dropped=True),
    ]
    assert findings(sound, SCENE, sweeps) == [
        "sweep 1: its recording was cut off after 100 pairs",
        "sweep 2: 20 of 120 samples fell into gaps of the palm poses",
        "sweep 3: 20 of 120 samples were missing, saturated or out of bounds",
    ]


def test_a_line_that_was_not_scanned_to_its_end_is_found(sound):
    scene = Scene("line", (Axis("x", 0.0, 0.2),), SCENE.phalanges[:1] and (Phalanx("index", (0.0,)),))
    scan = Scan(sound.states[:, :1], sound.strain[:, :8], sound.sweep, ("x",), ("index",))
    assert any(line.startswith("coverage: only 2") for line in findings(scan, scene, []))


def test_one_sweep_of_one_pair_is_judged_without_complaint_of_its_own(sound):
    findings(sound.select(np.array([0])), SCENE, [info()])
