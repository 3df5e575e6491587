"""Where stamps jump back another sweep begins, in recordings as live."""

import tempfile
from contextlib import suppress
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest
from support.bags import MS, SCENE, pose, posterior, slide, status, strain, write_bag

from tactile_localizer.errors import MeasurementError, ScanError
from tactile_localizer.io.bags.conversions import stamp_of
from tactile_localizer.io.bags.recording import read_bag
from tactile_localizer.io.csv.columns import channel_names
from tactile_localizer.io.csv.recording import read_csv
from tactile_localizer.io.scans.folder import ScanFolder
from tactile_localizer.io.scans.importer import import_recording
from tactile_localizer.io.scans.recorder import SweepRecorder
from tactile_localizer.io.scans.writer import ScanWriter
from tactile_localizer.io.strain_vectors import StrainReader
from tactile_localizer.streams.coverage import Coverage
from tactile_localizer.streams.palm_frame import PalmFrame
from tactile_localizer.streams.runs import runs_of
from tactile_localizer.streams.session import Session
from tactile_localizer.streams.sweep_detector import SweepDetector

STATUS, POSTERIOR = "tactile_mapping/status", "tactile_filter/posterior"


def faulty_stream(rng):
    """Strain and poses that jump back, are late, out of order or not finite, in the order of receipt."""
    happened, received_ms, stamp_ms, delay = [], 0, 20_000, rng.integers(0, 300)
    for _ in range(rng.integers(1, 5)):
        phase, length = rng.uniform(0, 6), rng.integers(200, 1500)
        for topic, period in (("strain", 5), ("palm_pose", 20)):
            for ms in range(0, length, period):
                late = rng.integers(0, 200) if rng.random() < 0.1 else 0
                x = np.nan if rng.random() < 0.05 else 0.025 + 0.03 * np.sin(phase + ms / 300)
                message = strain(stamp_ms + ms) if topic == "strain" else pose(stamp_ms + ms, x=x)
                at = received_ms + min(ms + late, length) + delay * (topic == "palm_pose")
                if rng.random() > 0.05:
                    happened.append((topic, int(at), message))
        silence = rng.integers(0, 3000)
        received_ms += length + silence
        stamp_ms += rng.choice([length + silence, -rng.integers(0, 9000)])
    return sorted(happened, key=lambda one: one[1])


def record_live(path, happened, detector=None, delay_s=0.0):
    """Record messages with the classes of the mapping node, in one sweep if none are detected.

    Returns the messages with the status at the begin and end of each sweep.
    """
    reader, frame, published = StrainReader(SCENE), PalmFrame(SCENE.axes), []

    def report(stamp_ns):
        message = status(0, recorder.is_active, recorder.number)
        stamp = message.header.stamp
        stamp.sec, stamp.nanosec = divmod(max(stamp_ns, 0), 10**9)
        published.append((STATUS, published[-1][1] if published else 0, message))

    session = Session(SCENE.axes, detector=detector, delay_s=delay_s)
    with ScanWriter(path, SCENE) as writer:
        recorder = SweepRecorder(writer, detector is not None, Coverage(SCENE), report)
        if detector is None:
            session.mark(0, -1, recorder.start(0, -1))
        for topic, ms, message in happened:
            published.append((topic, ms, message))
            if topic == "strain":
                session.add_strain(stamp_of(message), reader.read(message))
            else:
                place = message.pose.position
                with suppress(MeasurementError):
                    position = frame.position("material", (place.x, place.y, place.z), (0, 0, 0, 1))
                    session.add_pose(stamp_of(message), position)
            recorder.take(session.take())
        recorder.take(session.finish())
        recorder.close()
    return published


def content(path):
    """Numbers, pairs, gaps and skipped samples of the sweeps that have pairs."""
    sweeps = [sweep for sweep in ScanFolder(path).recording().sweeps if len(sweep)]
    return [
        (sweep.stamp_ns.tolist(), sweep.position.tolist(), sweep.strain.tolist(), sweep.gaps, sweep.skipped)
        for sweep in sweeps
    ]


def write_tables(folder, happened):
    """Strain and poses of messages as CSV files, each in the order of receipt."""
    reader = StrainReader(SCENE)
    channels = [name for each in SCENE.phalanges for name in channel_names(each.name, each.channels)]
    rows = {"strain": [["stamp_s", *channels]], "palm_pose": [["stamp_s", "x", "y"]]}
    for topic, _, message in happened:
        place = message.pose.position if topic == "palm_pose" else None
        values = reader.read(message)[0].tolist() if place is None else (place.x, place.y)
        rows[topic].append([Decimal(stamp_of(message)) / 10**9, *values])
    for topic, lines in rows.items():
        (folder / f"{topic}.csv").write_text("".join(f"{','.join(map(str, line))}\n" for line in lines))
    return folder / "strain.csv", folder / "palm_pose.csv"


@pytest.mark.parametrize(
    ("seed", "sweeps", "delay_s"),
    [
        (0, "both_ways", -0.05),
        (5, "one sweep", 0.07),
        (6, "one_way", 0.0),
        (220, "both_ways", 0.0),  # a status is received after the next jump
    ],
)
def test_an_imported_stream_equals_the_recorded_one(seed, sweeps, delay_s):
    """The doors of bags, by the motion or the node's status, and of CSV files feed the session."""
    happened = faulty_stream(np.random.default_rng(seed))
    jumps = [
        runs_of(np.array([stamp_of(message) for topic, _, message in happened if topic == wanted])).max()
        for wanted in ("strain", "palm_pose")
    ]
    one_way = sweeps == "one_way"
    live, bag, csv = (
        None if sweeps == "one sweep" else SweepDetector(SCENE.axes, one_way=one_way) for _ in range(3)
    )
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        published = record_live(folder / "live", happened, live, delay_s)
        live_scan = content(folder / "live")
        recordings = {
            "bag": read_bag(write_bag(folder / "messages", happened), SCENE, detector=bag, delay_s=delay_s),
            "status": read_bag(write_bag(folder / "published", published), SCENE, delay_s=delay_s),
        }
        if jumps[0] == jumps[1]:  # files do not say during which run of the poses strain arrived
            strains, poses = write_tables(folder, happened)
            recordings["csv"] = read_csv(strains, SCENE, poses=[poses], detector=csv, delay_s=delay_s)
        for kind, recording in recordings.items():
            if live_scan:
                import_recording(recording, SCENE, folder / kind, force=True)
                assert content(folder / kind) == live_scan, kind
            else:
                with pytest.raises(ScanError, match="found 0"):
                    import_recording(recording, SCENE, folder / kind, force=True)


def again(happened, received_ms):
    """The same messages once more, received later."""
    return [(topic, ms + received_ms, message) for topic, ms, message in happened]


def ranges(sweeps):
    return [
        (sweep.number, *np.round((sweep.stamp_ns[[0, -1]] / MS) % 100_000).astype(int)) for sweep in sweeps
    ]


def test_reported_sweeps_are_those_of_their_run(tmp_path):
    happened = slide(0, 2000)
    reported = [(50, 2, True), (700, 2, False), (1000, 3, True)]
    first = [(STATUS, ms, status(ms, on, number)) for ms, number, on in reported]
    # After the jump the node ends the open sweep with the stamp of its last sample, and begins another.
    late = [(STATUS, 2010, status(2000, False, 3)), (STATUS, 2010, status(0, True, 4))]
    last = [(STATUS, 3500, status(1500, False, 4))]
    happened = happened + first + again(happened, 2000) + late + last
    found = ranges(read_bag(write_bag(tmp_path / "bag", happened), SCENE).sweeps)
    assert found == [(2, 55, 700), (3, 1005, 2000), (4, 20, 1500)]


def test_sweeps_that_are_reported_after_a_jump_are_of_the_run_before(tmp_path):
    reported = [(60, 50, True, 2), (2100, 1500, False, 2), (2100, 1600, True, 3), (2150, 2000, False, 3)]
    reported += [(2150, 100, True, 4), (3500, 1500, False, 4)]
    statuses = [(STATUS, at, status(ms, on, number)) for at, ms, on, number in reported]
    happened = slide(0, 2000) + again(slide(0, 2000), 2000) + statuses
    found = ranges(read_bag(write_bag(tmp_path / "bag", happened), SCENE).sweeps)
    assert found == [(2, 55, 1500), (3, 1605, 2000), (4, 105, 1500)]


def test_a_jump_ends_a_localized_sweep(tmp_path):
    happened = slide(0, 2000)
    posteriors = [(POSTERIOR, ms + 3, posterior(ms, travel)) for ms, travel in [(500, 0.0), (1900, 0.02)]]
    posteriors += [(POSTERIOR, 2015, posterior(1990, 0.03))]  # received after the jump
    after = [(POSTERIOR, 2000 + ms, posterior(ms, 0.0)) for ms in (20, 30)]
    happened = happened + posteriors + again(happened, 2000) + after
    found = read_bag(write_bag(tmp_path / "bag", happened), SCENE, by_status=False)
    assert ranges(found.sweeps) == [(1, 500, 2000), (2, 20, 2000)]
