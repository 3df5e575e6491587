"""Other clocks, slow poses, and stamps that are far from their receipt are named."""

import re
from pathlib import Path

import numpy as np
import pytest

from tactile_localizer.scene import Axis
from tactile_localizer.streams.arrivals import Arrivals, Seen
from tactile_localizer.streams.clocks import clock_difference_s
from tactile_localizer.streams.findings import FINDINGS, findings
from tactile_localizer.streams.session import Session

AXES = (Axis("x", 0.0, 1.0),)
MS = 1_000_000


def said(seen, **options):
    return "; ".join(found.text for found in findings(seen, **options))


def gaps(strain_s, pose_s):
    stamps = (np.rint(np.multiply(each, 1e9)).astype(int) for each in (strain_s, pose_s))
    return said(Seen(AXES, *stamps, np.zeros((len(pose_s), 1)), 0.1))


def test_another_clock_is_named_with_both_ranges():
    assert gaps([5.0, 6.5], [1005.0, 1006.5]) == (
        "the poses are 1000 s ahead of the strain, another clock? strain from 5.000 to 6.500 s, "
        "poses from 1005.000 to 1006.500 s"
    )
    assert gaps([7.0, 8.0], [3.9]).startswith("the poses are 3.6 s behind the strain")
    assert gaps([7.0, 8.0], [6.95, 7.0]) == ""


def test_poses_of_another_length_are_no_other_clocks():
    found = gaps([5.0, 6.5], np.arange(1005.0, 1015.0, 0.05))
    assert found.startswith("the poses are of another recording? they last 9.95 s, the strain 1.5 s: strain")
    assert "another recording" not in gaps([5.0, 14.0], np.arange(5.0, 7.0, 0.05)), "they overlap"


@pytest.mark.parametrize("hours", [1.0, -1.0, 5.75, -9.5])
@pytest.mark.parametrize("length_s", [12.0, 12_000.0])
def test_the_difference_of_two_time_zones_is_exact(hours, length_s):
    strain_s = np.arange(0.02, length_s, 0.02)
    pose_s = np.arange(-0.3, length_s, 0.04) + 3600 * hours
    way = "ahead of" if hours > 0 else "behind"
    expected = f"the poses are {abs(3600 * hours):g} s {way} the strain, another time zone?"
    assert gaps(strain_s, pose_s).startswith(expected)


def test_another_difference_of_clocks_does_not_depend_on_a_late_begin():
    strain_s, pose_s = np.arange(0.0, 12.0, 0.02), np.arange(0.0, 12.0, 0.04) + 1234.5
    stamps = [np.rint(1e9 * each).astype(int) for each in (np.delete(strain_s, range(1, 50)), pose_s)]
    assert clock_difference_s(*stamps) == pytest.approx(1234.5, abs=0.5)
    assert (
        clock_difference_s(*[np.rint(1e9 * each).astype(int) for each in (strain_s, strain_s + 3.0)]) == 0.0
    )


def test_slow_poses_are_named_with_the_option():
    assert "the poses are 0.2 s apart" in gaps([0.0, 1.0], np.arange(0.0, 1.0, 0.2))
    assert "--max-gap 0.3" in gaps([0.0, 1.0], np.arange(0.0, 1.0, 0.2))


@pytest.mark.parametrize("pose_s", [np.arange(0.0, 4.0, 0.05), np.arange(6.0, 10.0, 0.05)])
def test_strain_without_poses_is_named(pose_s):
    assert gaps(np.arange(0.0, 10.0, 0.1), pose_s).startswith("most of the strain is before or after all")


def seen_with(late_ms, arrivals, period_ms, begin_ms):
    """A session whose poses are stamped some time before their receipt, and 4 s late at its begin."""
    session = Session(AXES, max_gap_s=0.5, arrivals=arrivals)
    for ms in range(0, 4000, period_ms):
        session.add_strain((ms + 1_000_000) * MS, None, ms * MS)
        late = 4000 if ms < begin_ms else late_ms
        session.add_pose((ms + 1_000_000 - late) * MS, np.array([ms * 1e-5]), ms * MS)
    return session.seen("max_gap_s")


@pytest.mark.parametrize("late_ms", [300, -300, 50])
@pytest.mark.parametrize(("live", "period_ms"), [(False, 10), (True, 10), (True, 200)])
def test_stamps_far_from_their_receipt_are_named_live_as_in_recordings(late_ms, live, period_ms):
    """Whatever the clock of the receiver; live those of the last seconds count, however many they are."""
    arrivals, begin_ms = (Arrivals(2000, 2.0), 2500) if live else (Arrivals(), 1500)
    seen = seen_with(late_ms, arrivals, period_ms, begin_ms)
    text = next((each.text for each in findings(seen, live=live) if each.name == "lead"), "")
    way = "behind" if late_ms > 0 else "ahead of"
    expected = (
        f"stamps are 0.30 s {way} the strain received with them: another clock, or the time of sending?"
    )
    assert text == (expected if abs(late_ms) == 300 else "")


def test_advice_names_the_option_of_the_door():
    slow = Seen(AXES, np.arange(0, 4000, 10) * MS, np.arange(0, 4000, 400) * MS, np.zeros((10, 1)), 0.1)
    assert "max_gap_s 0.6 is right" in said(Seen(**{**vars(slow), "option": "max_gap_s"}), live=True)
    assert "--max-gap 0.6 is right" in said(slow)


def test_each_finding_is_on_the_page_of_constants_with_its_threshold():
    page = (Path(__file__).resolve().parents[2] / "docs/constants.md").read_text()
    rows = dict(re.findall(r"^\| `(\w+)` \(`findings`\) \| ([^|]+) \|", page, re.MULTILINE))
    assert {name: float(value.split()[0]) for name, value in rows.items()} == {
        row.name: row.above for row in FINDINGS
    }
