"""Importing a bag gives the same scan as recording its topics live."""

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from support.bags import write_bag
from support.learned import unexamined

from tactile_localizer.cli import main
from tactile_localizer.io.scans.folder import ScanFolder


def there_and_back(stamp_ms):
    """Motion of 30 mm back and forth, beyond the bounds of the scene, with a wobble."""
    return 0.035 + 0.02 * np.cos(2 * np.pi * stamp_ms / 1600.0) + 1e-5 * np.sin(stamp_ms)


def contents(path):
    store, found = ScanFolder(path), ScanFolder(path).recording()
    sweeps = [(s.number, len(s), *s.stamp_ns[[0, -1]].tolist(), s.gaps, s.skipped) for s in found.sweeps]
    return store.scene, sweeps, store.load(), found


def assert_same_scan(live, imported):
    assert live[0] == imported[0]
    assert live[1] == imported[1]
    for name in ("states", "strain", "sweep"):
        np.testing.assert_array_equal(getattr(live[2], name), getattr(imported[2], name))
    for one, other in zip(live[3].sweeps, imported[3].sweeps, strict=True):
        np.testing.assert_array_equal(one.stamp_ns, other.stamp_ns)


@pytest.fixture(autouse=True)
def _unexamined(monkeypatch):
    monkeypatch.setattr("tactile_localizer.io.scans.learned.learn_model", unexamined)


def slide_badly(hand):
    """Slide with late, missing, repeated and wrong poses, and with samples that cannot be used."""
    hand.slide(500)
    hand.slide(100, late_ms=60)
    hand.slide(200, poses=False)
    hand.send_strain(hand.now_ms + 1, status=(1, 0, 0))
    hand.send_strain(hand.now_ms + 2, status=(0, 2, 0))
    hand.send_strain(hand.now_ms + 3, status=(0, 0, 1))
    hand.slide(200)
    for late_ms in (0, 40, 20):  # again, and out of order
        hand.send_pose(hand.now_ms - late_ms)
        hand.send_strain(hand.now_ms - late_ms)
    hand.send_pose(hand.now_ms + 1, x=np.nan)
    hand.send_strain(hand.now_ms + 1, strain=np.full(8 * len(hand.phalanges), np.nan))
    hand.slide(300)


def test_an_imported_bag_equals_the_live_scan(mapping, files, tmp_path):
    """Two sweeps, after which the clock is set back, which begins another one."""
    process, hand = mapping()
    hand.x = there_and_back
    happened = []
    for begin_ms, numbers in ((9000, (1, 2)), (3000, ())):
        hand.now_ms, first = begin_ms, len(hand.published)
        hand.slide(200 if numbers else 1000)
        hand.wait_for_stamp(hand.now_ms)
        for sweep in numbers:
            if sweep == 2:
                assert hand.service("end_sweep").success
                hand.slide(100)
                hand.wait_for_stamp(hand.now_ms)
            assert hand.service("start_sweep").success
            slide_badly(hand)
            hand.wait_for_stamp(hand.now_ms)
        happened += hand.published[first:]
        happened += [("tactile_mapping/status", 0, serialize_message(each)) for each in hand.statuses]
        hand.statuses.clear()
    assert process.stop() == 0
    live = contents(files["scan_file"])
    assert [sweep[0] for sweep in live[1]] == [1, 2, 3]
    assert all(gaps and skipped for *_, gaps, skipped in live[1][:2])
    bag = write_bag(tmp_path / "bag", [(topic, at, raw) for at, (topic, _, raw) in enumerate(happened)])
    arguments = ["import", "bag", bag, "--scene", files["scene_file"], "-o", tmp_path / "imported_scan"]
    assert main([str(argument) for argument in arguments]) == 0
    assert_same_scan(live, contents(tmp_path / "imported_scan"))


def test_detected_sweeps_of_a_bag_equal_the_live_ones(mapping, files, tmp_path):
    process, hand = mapping(sweep_detection="both_ways")
    hand.x = there_and_back
    assert "expected sweep_detection off" in hand.service("start_sweep").message
    slide_badly(hand)
    slide_badly(hand)
    hand.wait_for_stamp(hand.now_ms)
    assert process.stop() == 0
    live = contents(files["scan_file"])
    assert len(live[1]) >= 3
    by_status = write_bag(tmp_path / "by_status", hand.published_with_status())
    by_motion = write_bag(tmp_path / "by_motion", hand.published)
    for bag, options in ((by_status, []), (by_motion, ["--detect-sweeps", "both_ways"])):
        output = tmp_path / f"{bag.name}_scan"
        arguments = ["import", "bag", bag, "--scene", files["scene_file"], "-o", output, *options]
        assert main([str(argument) for argument in arguments]) == 0
        assert_same_scan(live, contents(output))
