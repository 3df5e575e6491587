"""Bags are read whatever their storage; damaged ones are refused with commands that may repair them."""

import dataclasses
import os
import sqlite3
import zipfile
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from support.bags import (
    MS,
    SCENE,
    START,
    STORE,
    TYPES,
    file_of,
    moved,
    pose,
    posterior,
    slide,
    status,
    strain,
    write_bag,
    x_at,
)
from support.notes import counts

from tactile_localizer.errors import ScanError, SceneError
from tactile_localizer.io.bags.recording import read_bag
from tactile_localizer.io.strain_adapter import adapter_from_dict
from tactile_localizer.scene import Axis, Phalanx, Scene
from tactile_localizer.streams.palm_frame import PalmFrame
from tactile_localizer.streams.sweep_detector import SweepDetector

STRAIN_MS = np.arange(20, 2001, 5)


def whole(path, storage="mcap", compression="none", last_ms=2000):
    return write_bag(path, slide(0, last_ms), storage, compression)


def assert_whole(sweep, strain_ms=STRAIN_MS):
    np.testing.assert_array_equal(sweep.stamp_ns, START + strain_ms * MS)
    np.testing.assert_allclose(sweep.position[:, 0], x_at(strain_ms), atol=1e-12)
    np.testing.assert_array_equal(sweep.strain[:, 0], strain_ms + 8000)
    np.testing.assert_array_equal(sweep.strain[:, 8], strain_ms)
    assert not sweep.status.any()


def ranges_ms(sweeps):
    """First and last stamp of each sweep."""
    return [tuple((sweep.stamp_ns[[0, -1]] - START) // MS) for sweep in sweeps]


EVERY_STORAGE = [("mcap", "storage"), *product(("mcap", "sqlite3"), ("none", "message", "file"))]


@pytest.mark.parametrize(("storage", "compression"), EVERY_STORAGE)
def test_all_storages_give_the_same_recording(tmp_path, storage, compression):
    bag = whole(tmp_path / "bag", storage, compression)
    files = [bag] if compression != "none" else [bag, *bag.glob("*.mcap"), *bag.glob("*.db3")]
    for path in files:
        recording = read_bag(path, SCENE)
        (sweep,) = recording.sweeps
        assert_whole(sweep)
        assert sweep.gaps == 3, "before the first pose"
        assert sweep.truth is None
        assert recording.notes == ()


def test_progress_is_reported(tmp_path):
    fractions = []
    read_bag(whole(tmp_path / "bag", last_ms=6000), SCENE, progress=lambda text, done: fractions.append(done))
    assert fractions == [0.0, 2 / 3]


def noisy(content, place):
    begin = round(place * len(content))
    return content[:begin] + np.random.default_rng(0).bytes(4096) + content[begin + 4096 :]


def cut_short(content, place):
    return content[: round(place * len(content))]


@pytest.mark.parametrize(
    ("storage", "damage", "place"),
    [
        *product(("mcap", "sqlite3"), (cut_short,), (0.0, 0.3, 0.7)),
        ("sqlite3", cut_short, 0.99),
        *product(("mcap",), (noisy,), (0.2, 0.5, 0.8)),
    ],
)
def test_a_damaged_bag_is_refused_with_the_commands_that_may_repair_it(tmp_path, storage, damage, place):
    bag = whole(tmp_path / "bag", storage, last_ms=20_000)
    file_of(bag).write_bytes(damage(file_of(bag).read_bytes(), place))
    with pytest.raises(ScanError, match=r"expected a readable bag.*bag reindex.*mcap recover") as refusal:
        read_bag(bag, SCENE)
    assert "\n" not in str(refusal.value)


def test_truth_is_interpolated(tmp_path):
    truths = [
        ("tactile_simulator/ground_truth", ms, pose(ms, x=0.02 + ms * 1e-6)) for ms in range(1000, 1501, 10)
    ]
    sweep = read_bag(write_bag(tmp_path / "bag", slide(0, 2000) + truths), SCENE).sweeps[0]
    known = (STRAIN_MS >= 1000) & (STRAIN_MS <= 1500)
    np.testing.assert_array_equal(np.isfinite(sweep.truth[:, 0]), known)
    np.testing.assert_allclose(sweep.truth[known, 0], 0.02 + STRAIN_MS[known] * 1e-6, atol=1e-12)


def test_true_poses_whose_stamps_do_not_increase_are_counted(tmp_path):
    truths = [("tactile_simulator/ground_truth", ms, pose(ms - ms % 40)) for ms in range(0, 2001, 20)]
    truths += [("tactile_simulator/ground_truth", 2001, pose(200))]
    notes = read_bag(write_bag(tmp_path / "bag", slide(0, 2000) + truths[2:]), SCENE).notes
    what = "100 poses of /tactile_simulator/ground_truth"
    assert notes == (
        f"skipped 49 of {what} whose stamps do not increase",
        f"1 of {what} have stamps that jump back: another run begins",
    )


@pytest.mark.parametrize("clock_ms", [-3_600_000, 3_600_000, 12_345_678])
def test_poses_of_another_clock_are_gaps_and_a_finding(tmp_path, clock_ms):
    happened = [
        (topic, ms, pose(4_000_000 + clock_ms + ms) if topic == "palm_pose" else strain(4_000_000 + ms))
        for topic, ms, _ in slide(0, 2000)
    ]
    recording = read_bag(write_bag(tmp_path / "bag", happened), SCENE)
    ((gaps, left),) = ((each.gaps, len(each)) for each in recording.sweeps)
    assert (gaps, left) == (400, 0)
    assert "the strain, another " in recording.notes[0]


@pytest.mark.parametrize("name", ["BAG.MCAP", "BAG.MCAP.ZSTD", "Bag.DB3"])
def test_suffixes_are_read_in_upper_case(tmp_path, name):
    compression = "file" if name.endswith("ZSTD") else "none"
    bag = whole(tmp_path / "bag", "sqlite3" if name.endswith("3") else "mcap", compression)
    file = file_of(bag).rename(tmp_path / name)
    assert_whole(read_bag(file, SCENE).sweeps[0])
    (bag / "metadata.yaml").unlink()
    file.rename(bag / name)
    assert_whole(read_bag(bag, SCENE).sweeps[0])


def test_sweeps_follow_the_mapping_status(tmp_path):
    statuses = [
        status(0, False, 0),
        status(100, True, 1),
        status(300, True, 1),
        status(500, False, 1),
        status(700, False, 1),
        status(800, True, 2),
        status(900, True, 3),
    ]
    received = [90, 110, 310, 520, 700, 810, 905]
    happened = [("tactile_mapping/status", ms, m) for ms, m in zip(received, statuses, strict=True)]
    bag = write_bag(tmp_path / "bag", slide(0, 2000) + happened)
    sweeps = read_bag(bag, SCENE).sweeps
    assert [sweep.number for sweep in sweeps] == [1, 2, 3]
    assert ranges_ms(sweeps) == [(105, 500), (805, 900), (905, 2000)]
    assert len(read_bag(bag, SCENE, by_status=False).sweeps) == 1


def test_sweeps_follow_global_localizations(tmp_path):
    travels = {100: 0.0, 200: 0.0, 300: 0.001, 400: 0.0009, 1000: 0.0, 1200: 0.004, 1600: 0.0, 1800: 0.0}
    posteriors = [
        ("tactile_filter/posterior", ms + 3, posterior(ms, travel)) for ms, travel in travels.items()
    ]
    bag = write_bag(tmp_path / "bag", slide(0, 2000) + posteriors)
    assert ranges_ms(read_bag(bag, SCENE, by_status=False).sweeps) == [(100, 995), (1000, 1595), (1600, 2000)]
    assert len(read_bag(bag, SCENE).sweeps) == 1


def test_a_hand_that_rests_or_is_not_seen_makes_no_sweep(tmp_path):
    resting, lost = moved(slide(0, 200), lambda ms: 0.01), moved(slide(0, 200), frame="map")
    bag = write_bag(tmp_path / "resting", resting)
    assert read_bag(bag, SCENE, detector=SweepDetector(SCENE.axes)).sweeps == ()
    with pytest.raises(
        ScanError, match=r"skipped 10 of 10 messages of /palm_pose: .* --reference-frame names"
    ):
        read_bag(write_bag(tmp_path / "lost", lost), SCENE)


def test_sweeps_follow_an_activity_topic_after_the_filter_has_started(tmp_path):
    actives = {300: True, 500: False, 1000: True, 1400: False, 1500: True, 1800: False}
    happened = [
        ("tactile_simulator/sweep_active", ms, STORE.types[TYPES["tactile_simulator/sweep_active"]](data=on))
        for ms, on in actives.items()
    ]
    happened += [("tactile_filter/posterior", ms, posterior(ms, 0.0)) for ms in (800, 900, 1200, 1600)]
    bag = write_bag(tmp_path / "bag", slide(0, 2000) + happened)
    sweeps = read_bag(bag, SCENE, by_status=False).sweeps
    assert ranges_ms(sweeps) == [(1005, 1400), (1505, 1800)]
    assert [sweep.number for sweep in sweeps] == [1, 2]


@pytest.mark.parametrize(("clock_ms", "first_ms"), [(0, 305), (3_600_000, 205)])
def test_strain_that_is_received_late_is_of_the_time_before_the_sweep(tmp_path, clock_ms, first_ms):
    """With stamps of another clock than the recorder's, the newest strain is the present."""
    late = [(topic, max(ms, 400) if ms > 200 else ms, m) for topic, ms, m in slide(0, 2000)]
    active = STORE.types[TYPES["tactile_simulator/sweep_active"]](data=True)
    happened = [*late, ("tactile_simulator/sweep_active", 300, active)]
    bag = write_bag(tmp_path / "bag", [(topic, ms + clock_ms, message) for topic, ms, message in happened])
    assert ranges_ms(read_bag(bag, SCENE, by_status=False).sweeps) == [(first_ms, 2000)]


def test_a_flag_before_late_strain_is_in_the_clock_of_the_strain(tmp_path):
    """The sender's clock is .3 s ahead, and the strain after 1 s is received .4 s late."""
    late = [(topic, (max(ms, 1400) if ms > 1000 else ms) - 300, m) for topic, ms, m in slide(400, 2000)]
    active = STORE.types[TYPES["tactile_simulator/sweep_active"]](data=True)
    bag = write_bag(tmp_path / "bag", [*late, ("tactile_simulator/sweep_active", 900, active)])
    assert ranges_ms(read_bag(bag, SCENE, by_status=False).sweeps) == [(1205, 2000)]


def test_skipped_messages_are_counted(tmp_path):
    happened = slide(0, 500) + slide(800, 1000)
    happened.insert(60, ("strain", 250, strain(100)))
    happened.insert(61, ("palm_pose", 250, pose(100)))
    happened.insert(62, ("palm_pose", 250, pose(250, frame="map")))
    happened.insert(63, ("strain", 250, strain(251, strain=np.zeros(3))))
    happened += [("strain", 201, b"\0\1\0\0"), ("strain", 202, b""), ("palm_pose", 203, b"\0\1")]
    bag = write_bag(tmp_path / "bag", [(topic, index, m) for index, (topic, _, m) in enumerate(happened)])
    recording = read_bag(bag, SCENE)
    assert recording.sweeps[0].gaps == 3 + 3
    assert counts(recording.notes) == [(2, 38), (3, 144), (1, 141), (1, 36)]
    assert any("frame 'map': expected" in note and "--reference-frame" in note for note in recording.notes)


def test_a_topic_of_another_type_is_refused(tmp_path):
    with pytest.raises(
        ScanError, match="topic /palm_pose: expected tactile_localizer/msg/StrainVectors, found geo"
    ):
        read_bag(whole(tmp_path / "bag"), SCENE, topics={"strain": "palm_pose", "pose": "other"})


def test_topics_and_frames_are_configurable(tmp_path):
    bag = write_bag(tmp_path / "bag", moved(slide(0, 200), frame="robot"))
    frame = PalmFrame(SCENE.axes, reference_frame="robot", material_pose=[-0.01, 0, 0, 0, 0, 0])
    sweep = read_bag(bag, SCENE, topics={"strain": "strain", "pose": "palm_pose"}, frame=frame).sweeps[0]
    np.testing.assert_allclose(sweep.position[0], [x_at(20) + 0.01, 0.02], atol=1e-12)
    with pytest.raises(ScanError, match=r"expected messages of /felt, found /palm_pose \(geometry_msgs"):
        read_bag(bag, SCENE, topics={"strain": "/felt"})


def foreign_database(path):
    with sqlite3.connect(path) as connection:
        connection.execute("CREATE TABLE song (title TEXT)")


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("none.mcap", lambda path: None),
        ("ros1.bag", lambda path: path.write_text("#ROSBAG V2.0")),
        ("empty.mcap", Path.touch),
        ("text.mcap", lambda path: path.write_text("not a bag at all" * 100)),
        ("pipe.mcap", os.mkfifo),
        ("x" * 300, lambda path: None),
        ("folder", Path.mkdir),
        ("zip", lambda path: zipfile.ZipFile(path, "w").close()),
        ("song.db3", foreign_database),
    ],
)
def test_other_files_than_bags_are_refused(tmp_path, name, make):
    make(tmp_path / name)
    with pytest.raises(ScanError, match=rf"{tmp_path / name}: expected a (readable )?bag") as refusal:
        read_bag(tmp_path / name, SCENE)
    assert "\n" not in str(refusal.value)


def test_a_missing_phalanx_is_named(tmp_path):
    thumb = Scene("sheet", (Axis("x", 0.0, 1.0),), (Phalanx("thumb", (0.0,)),))
    with pytest.raises(SceneError, match="phalanx 'thumb' of scene 'sheet': expected one of middle, index"):
        read_bag(whole(tmp_path / "bag"), thumb)


def test_an_adapter_reads_other_messages(tmp_path):
    kind = "std_msgs/msg/Float64MultiArray"
    layout = STORE.types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    happened = [("palm_pose", ms, pose(ms)) for ms in range(10, 500, 10)]
    for ms in range(10, 500, 10):
        data = ms + np.arange(15.0 if ms == 250 else 16.0)
        happened.append(("taxels", ms, STORE.types[kind](layout=layout, data=data)))
    bag = write_bag(tmp_path / "bag", happened)
    scene = dataclasses.replace(SCENE, phalanges=(Phalanx("index", (0.0, 0.0), 16),))
    entry = {"topic": "taxels", "type": kind, "channels": 16}
    adapter = adapter_from_dict({"phalanges": {"index": entry}})
    recording = read_bag(bag, scene, adapter=adapter)
    (sweep,) = recording.sweeps
    strain_ms = np.setdiff1d(np.arange(10, 500, 10), [250])
    np.testing.assert_array_equal(sweep.strain[:, 3], strain_ms + 3.0)
    np.testing.assert_array_equal(sweep.stamp_ns, START + strain_ms * MS)
    np.testing.assert_allclose(sweep.position[:, 0], x_at(strain_ms), atol=1e-12)
    (note,) = recording.notes
    assert "expected 16 channels for phalanx index, got 15" in note
    assert len(read_bag(bag, scene, adapter=adapter)) == len(sweep), "the adapter begins anew"
    with pytest.raises(SceneError, match="expected 8 channels, got 16"):
        read_bag(bag, dataclasses.replace(SCENE, phalanges=SCENE.phalanges[:1]), adapter=adapter)
    for wrong, found in (
        ({"topic": "other"}, "expected messages of /other, found /palm_pose"),
        ({"field": "data[0:3]"}, r"found none: skipped 49 of 49 .* expected numbers in field data\[0:3\]"),
    ):
        other = adapter_from_dict({"phalanges": {"index": {**entry, **wrong}}})
        with pytest.raises(ScanError, match=found):
            read_bag(bag, scene, adapter=other)
