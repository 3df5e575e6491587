"""Every file of a bag is read or named, and only the wanted topics are opened."""

import shutil
import sqlite3
import struct
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.typesys import get_types_from_msg
from support.bags import MS, SCENE, START, STORE, TYPES, file_of, pose, slide, strain, write_bag

from tactile_localizer.errors import ScanError
from tactile_localizer.io.bags.reader import typestore
from tactile_localizer.io.bags.recording import read_bag
from tactile_localizer.io.readers import reader_of
from tactile_localizer.io.strain_adapter import adapter_from_dict
from tactile_localizer.library import read_recording
from tactile_localizer.scene import Axis, Phalanx, Scene

STRAIN_MS = np.arange(20, 1001, 5)


def assert_whole(path, **options):
    recording = read_bag(path, SCENE, **options)
    (sweep,) = recording.sweeps
    np.testing.assert_array_equal(sweep.stamp_ns, START + STRAIN_MS * MS)
    assert recording.notes == ()


FOREIGN = {
    "log in JSON": ("jsonschema", "json", b'{"type": "object"}'),
    "protobuf": ("protobuf", "protobuf", b"\x0a\x80\xff"),
    "service events": ("ros2msg", "cdr", b"bool data\n---\nbool success\n"),
    "unknown definition": ("unknown", "cdr", b""),
    "unusual IDL": ("ros2idl", "cdr", b"module a { union U switch (long) { case 1: long b; }; };"),
    "no schema": None,
}


def copied(bag, path, foreign, **options):
    """The messages of an MCAP bag in another one, with a foreign topic."""
    with file_of(bag).open("rb") as source, path.open("wb") as target:
        writer = Writer(target, **options)
        writer.start(profile="", library="another")
        channels = {}
        language, encoding, text = foreign or ("", "json", b"")
        schema = writer.register_schema("Foreign", language, text) if foreign else 0
        other = writer.register_channel("/foreign", encoding, schema)
        for kind, channel, message in make_reader(source).iter_messages():
            if channel.topic not in channels:
                copy = writer.register_schema(kind.name, kind.encoding, kind.data)
                channels[channel.topic] = writer.register_channel(channel.topic, "cdr", copy)
            times = message.log_time, message.publish_time
            writer.add_message(channels[channel.topic], times[0], message.data, times[1])
            writer.add_message(other, times[0], b"{}", times[1])
        writer.finish()
    return path


@pytest.mark.parametrize("foreign", FOREIGN)
def test_topics_that_are_not_wanted_may_be_of_any_kind(tmp_path, foreign):
    bag = write_bag(tmp_path / "bag", slide(0, 1000))
    assert_whole(copied(bag, tmp_path / "own.mcap", FOREIGN[foreign]))


@pytest.mark.parametrize(
    "options",
    [
        {"use_chunking": False},
        {"use_statistics": False, "use_summary_offsets": False},
        {"index_types": IndexType.NONE},
        {"use_statistics": False, "repeat_channels": False, "repeat_schemas": False},
        {"compression": CompressionType.LZ4, "chunk_size": 5000},
    ],
)
def test_an_mcap_file_needs_no_index(tmp_path, options):
    bag = write_bag(tmp_path / "bag", slide(0, 1000))
    assert_whole(copied(bag, tmp_path / "own.mcap", None, **options))


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_service_events_as_rosbag2_stores_them_do_not_matter(tmp_path, storage):
    event = "bool data\n---\nbool success\nstring message\n"
    with BagWriter(tmp_path / "bag", version=9, storage_plugin=StoragePlugin[storage.upper()]) as writer:
        kind, hash_ = "own/srv/Set_Event", "RIHS01_" + 64 * "0"
        events = writer.add_connection("/set/_service_event", kind, msgdef=event, rihs01=hash_)
        topics = {
            topic: writer.add_connection(topic, TYPES[topic], typestore=STORE)
            for topic in ("strain", "palm_pose")
        }
        for topic, ms, message in slide(0, 1000):
            writer.write(topics[topic], START + ms * MS, STORE.serialize_cdr(message, TYPES[topic]))
            writer.write(events, START + ms * MS, bytes(64))
    assert_whole(tmp_path / "bag")


@pytest.mark.parametrize("topic", ["strain", "palm_pose"])
def test_topics_may_lack_the_slash(tmp_path, topic):
    bag = write_bag(tmp_path / "bag", slide(0, 1000), slash="")
    assert_whole(bag)
    name = topic.replace("palm_", "")
    assert_whole(bag, topics={name: topic})
    assert_whole(bag, topics={name: f"/{topic}"})


NUMBERED = "bag_{}", "{}_bag_2026_11_28-09_59_0{}"
"""Names of the parts of a bag, before Lyrical and since."""


@pytest.mark.parametrize("name", NUMBERED)
@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_folder_without_metadata_is_its_files_in_order(tmp_path, storage, name):
    folder = tmp_path / "bag"
    folder.mkdir()
    for part in range(11):  # bag_10 comes after bag_9
        bag = write_bag(tmp_path / f"part_{part}", slide(91 * part, min(91 * part + 91, 1000)), storage)
        shutil.copy(file_of(bag), folder / f"{name.format(part, part % 10)}{file_of(bag).suffix}")
    (folder / "notes.txt").write_text("recorded on the large table")
    assert_whole(folder)


@pytest.mark.parametrize("name", NUMBERED)
def test_a_part_that_is_missing_or_not_named_is_noted(tmp_path, name):
    folder = tmp_path / "bag"
    folder.mkdir()
    first, second, third = names = [f"{name.format(part, part)}.mcap" for part in (0, 1, 2)]
    for part, file in enumerate(names):
        bag = write_bag(tmp_path / f"part_{part}", slide(400 * part, 400 * part + 400))
        shutil.copy(file_of(bag), folder / file)
    assert read_bag(folder, SCENE).notes == ()
    (folder / second).unlink()
    assert read_bag(folder, SCENE).notes == (f"there is no file between {first} and {third}",)
    whole = write_bag(tmp_path / "whole", slide(0, 1000))
    shutil.copy(folder / first, whole / "whole_1.mcap")
    assert read_bag(whole, SCENE).notes == ("metadata.yaml does not name whole_1.mcap: left out",)


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_compressed_file_is_read_without_its_metadata(tmp_path, storage):
    file = file_of(write_bag(tmp_path / "bag", slide(0, 1000), storage, "file"))
    assert file.suffix == ".zstd"
    assert reader_of(file).kind == "bag"
    assert_whole(file)
    (tmp_path / "bag" / "metadata.yaml").unlink()
    assert_whole(tmp_path / "bag")
    file.write_bytes(file.read_bytes()[:-50])
    with pytest.raises(ScanError, match="the compressed file is cut short"):
        read_bag(file, SCENE)


@pytest.mark.parametrize("place", [0.3, 0.7, 0.95])
def test_a_killed_recorder_leaves_an_mcap_file_whose_whole_chunks_are_read(tmp_path, place):
    chunks = {"chunk_size": 2000, "use_chunking": True}
    path = copied(write_bag(tmp_path / "bag", slide(0, 2000), "mcap"), tmp_path / "cut.mcap", None, **chunks)
    whole, content = read_bag(path, SCENE), path.read_bytes()
    path.write_bytes(content[: round(place * len(content))])
    found = read_bag(path, SCENE)
    assert found.notes[0] == "cut.mcap ends within the recording: the last messages are missing"
    assert place * len(whole) * 0.7 < len(found) <= len(whole)
    begun = whole.sweeps[0].stamp_ns[: len(found)]
    np.testing.assert_array_equal(found.sweeps[0].stamp_ns, begun)


def test_messages_that_an_mcap_file_counts_are_all_there(tmp_path):
    bag = write_bag(tmp_path / "bag", slide(0, 1000))
    path = copied(bag, tmp_path / "own.mcap", None, enable_crcs=False)
    count = struct.Struct("<HQ")  # of messages by channel, as the statistics have it
    content = path.read_bytes()
    (channel,) = (each for each in range(1, 4) if count.pack(each, 200) in content[-1000:])
    more = content[-1000:].replace(count.pack(channel, 200), count.pack(channel, 201))
    path.write_bytes(content[:-1000] + more)
    with pytest.raises(ScanError, match=r"201 messages of .* were recorded, found 200"):
        read_bag(path, SCENE)


def test_a_bag_of_ros_1_is_named_with_what_converts_it(tmp_path):
    (tmp_path / "old.bag").write_bytes(b"#ROSBAG V2.0")
    with pytest.raises(ScanError, match=r"old.bag: expected a bag .*, found one of ROS 1 \(rosbags-convert"):
        read_recording(tmp_path / "old.bag", SCENE)


def test_files_that_the_metadata_name_are_all_there(tmp_path):
    bag = write_bag(tmp_path / "bag", slide(0, 1000))
    renamed = file_of(bag).rename(bag / "monday.mcap")
    with pytest.raises(ScanError, match=r"expected bag\.mcap, which .* names, found monday\.mcap; remove it"):
        read_bag(bag, SCENE)
    renamed.rename(tmp_path / "elsewhere.mcap")
    with pytest.raises(ScanError, match=r"expected bag\.mcap, which metadata\.yaml names, found none"):
        read_bag(bag, SCENE)
    shutil.copy(file_of(write_bag(tmp_path / "first", slide(0, 500))), bag / "bag.mcap")
    with pytest.raises(ScanError, match=r"200 messages of /strain were recorded, found 100"):
        read_bag(bag, SCENE)
    (bag / "metadata.yaml").write_text("rosbag2_bagfile_information: {")
    with pytest.raises(ScanError, match=r"metadata\.yaml is damaged; remove it, and the files are read"):
        read_bag(bag, SCENE)


def crashed(path: Path) -> Path:
    """A database whose recorder was killed: half of the messages are only in its write-ahead log."""
    whole = file_of(write_bag(path / "bag", slide(0, 1000), "sqlite3"))
    with closing(sqlite3.connect(whole)) as database:
        database.execute("PRAGMA journal_mode = WAL")
        rows = database.execute("SELECT * FROM messages WHERE id > 120").fetchall()
        database.execute("DELETE FROM messages WHERE id > 120")
        database.commit()
        database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        for begin in range(0, len(rows), 20):
            database.executemany("INSERT INTO messages VALUES (?, ?, ?, ?)", rows[begin : begin + 20])
            database.commit()
        for ending in ("", "-wal"):
            shutil.copy(f"{whole}{ending}", path / f"live.db3{ending}")
    return path / "live.db3"


def test_messages_in_the_log_of_a_killed_recorder_are_read(tmp_path):
    path = crashed(tmp_path)
    before = {each.name: each.read_bytes() for each in tmp_path.iterdir() if each.is_file()}
    assert len(before["live.db3-wal"]) > 30_000
    assert_whole(path)
    assert before == {each.name: each.read_bytes() for each in tmp_path.iterdir() if each.is_file()}


@pytest.mark.parametrize("place", [3, 20, 40, 0.4, 0.8])
def test_a_damaged_log_is_named(tmp_path, place):
    path = crashed(tmp_path)
    log = Path(f"{path}-wal")
    content = bytearray(log.read_bytes())
    content[place if place >= 1 else round(place * len(content))] ^= 0x55
    log.write_bytes(content)
    with pytest.raises(ScanError, match=r"live\.db3-wal is damaged"):
        read_bag(path, SCENE)


def test_a_log_that_ends_within_a_transaction_is_noted(tmp_path):
    path = crashed(tmp_path)
    log = Path(f"{path}-wal")
    log.write_bytes(log.read_bytes()[:-3000])
    recording = read_bag(path, SCENE)
    assert 100 < len(recording) < len(STRAIN_MS)
    assert recording.notes == ("live.db3-wal ends within a transaction: the last messages are missing",)


def test_older_pages_behind_a_log_are_no_damage(tmp_path):
    path = crashed(tmp_path)
    log = Path(f"{path}-wal")
    log.write_bytes(log.read_bytes() + 2 * bytes(24 + 4096))
    assert_whole(path)


SKIN, PAD = "std_msgs/Header header\nPad[] pads\n", "float32 fx\nfloat32 fz\n"


def own_bag(path, definitions):
    """A bag of arrays of pads, with the definitions of its messages or without, as of Foxy and Humble."""
    store = typestore()
    types = get_types_from_msg(SKIN, "skin_msgs/msg/Skin") | get_types_from_msg(PAD, "skin_msgs/msg/Pad")
    store.register(types)
    pad, skin = store.types["skin_msgs/msg/Pad"], store.types["skin_msgs/msg/Skin"]
    happened = [("palm_pose", ms, pose(ms)) for ms in range(10, 500, 10)]
    for ms in range(10, 500, 10):
        pads = [pad(fx=0.0, fz=float(ms + number)) for number in range(4)]
        happened.append(("skin", ms, skin(header=pose(ms).header, pads=pads)))
    bag = write_bag(path, happened, "sqlite3", store=store)
    if not definitions:
        with closing(sqlite3.connect(file_of(bag))) as database:
            database.execute("DROP TABLE message_definitions")
            database.execute("DROP TABLE schema")
            database.commit()
    return bag


PADS = Scene("line", (Axis("x", 0.0, 0.05),), (Phalanx("tip", (0.0,), 4),))
ADAPTER = {
    "phalanges": {"tip": {"topic": "/skin", "type": "skin_msgs/msg/Skin", "field": "pads.fz", "channels": 4}}
}


def assert_pads(recording):
    (sweep,) = recording.sweeps
    np.testing.assert_array_equal(sweep.strain, np.arange(10, 500, 10)[:, None] + np.arange(4.0))


def test_a_field_of_each_message_of_an_array_is_a_channel(tmp_path):
    assert_pads(read_bag(own_bag(tmp_path / "bag", True), PADS, adapter=adapter_from_dict(ADAPTER)))


def test_a_definition_in_a_bag_may_have_the_line_ends_of_windows(tmp_path):
    bag = own_bag(tmp_path / "bag", True)
    with closing(sqlite3.connect(file_of(bag))) as database:
        update = (
            "UPDATE message_definitions SET encoded_message_definition = replace({0}, char(10), char(13, 10))"
        )
        database.execute(update.format("encoded_message_definition"))
        database.commit()
    assert_pads(read_bag(bag, PADS, adapter=adapter_from_dict(ADAPTER)))


@pytest.mark.parametrize("folder", ["skin_msgs/msg", "."])
def test_definitions_that_a_bag_lacks_are_read_from_a_folder(tmp_path, folder):
    bag, adapter = own_bag(tmp_path / "bag", False), adapter_from_dict(ADAPTER)
    refusal = (
        r"topic /skin: expected a definition of skin_msgs/msg/Skin in the bag, found none.*--definitions"
    )
    with pytest.raises(ScanError, match=refusal):
        read_bag(bag, PADS, adapter=adapter)
    with pytest.raises(ScanError, match=r"expected a folder of \.msg files, found none"):
        read_bag(bag, PADS, adapter=adapter, definitions=tmp_path / "none")
    files = tmp_path / "ws" / folder
    files.mkdir(parents=True)
    (files / "Skin.msg").write_text(SKIN)
    with pytest.raises(ScanError, match=r"expected a definition of skin_msgs/msg/Pad in the bag, found none"):
        read_bag(bag, PADS, adapter=adapter, definitions=tmp_path / "ws")
    (files / "Pad.msg").write_text(PAD)
    assert_pads(read_bag(bag, PADS, adapter=adapter, definitions=tmp_path / "ws"))
    for text in (PAD, "\ufeff# Windows\n" + PAD):
        (files / "Pad.msg").write_bytes(text.replace("\n", "\r\n").encode())
        assert_pads(read_bag(bag, PADS, adapter=adapter, definitions=tmp_path / "ws"))
    (files / "Pad.msg").write_bytes(b"# \xb5N\n" + PAD.encode())
    assert_pads(read_bag(bag, PADS, adapter=adapter, definitions=tmp_path / "ws"))
    (files / "Pad.msg").write_text("float32 [fx\n")
    with pytest.raises(ScanError, match=r"Pad\.msg: expected a message definition"):
        read_bag(bag, PADS, adapter=adapter, definitions=tmp_path / "ws")


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_own_messages_need_no_definition_in_the_bag(tmp_path, storage):
    assert_whole(write_bag(tmp_path / "bag", slide(0, 1000), storage, defined=False))


def test_receipt_that_jumps_back_keeps_the_order_of_the_file(tmp_path):
    """As when the clock of the robot, and thus of the recorder, is set back."""
    stamps_ms = [*range(10_000, 11_500, 10), *range(10_500, 12_000, 10)]
    happened = [
        (topic, ms, message(ms))
        for ms in stamps_ms
        for topic, message in (("palm_pose", pose), ("strain", strain))
    ]
    bag = write_bag(tmp_path / "bag", happened, by_receipt=False)
    assert [len(sweep) for sweep in read_bag(bag, SCENE).sweeps] == [150, 150]
