"""Serialised messages are written to a bag unchanged."""

import pytest
from support.bags import MS, START, STORE, TYPES, pose, strain

from tactile_localizer.errors import ScanError
from tactile_localizer.io.bags.reader import Wanted, read_messages
from tactile_localizer.io.bags.writer import BagWriter

TOPICS = {f"/{topic}": TYPES[topic] for topic in ("strain", "palm_pose")}
WANTED = {topic: Wanted(kind, lambda message, _: message) for topic, kind in TOPICS.items()}


def raw(topic, message):
    return bytes(STORE.serialize_cdr(message, TYPES[topic]))


def test_written_messages_are_read_back(tmp_path):
    with BagWriter(tmp_path / "bag", TOPICS) as bag:
        for stamp_ms in (5, 10, 15):
            bag.write("/strain", START + stamp_ms * MS, raw("strain", strain(stamp_ms)))
            bag.write("/palm_pose", START + stamp_ms * MS, raw("palm_pose", pose(stamp_ms)))
    read = read_messages(tmp_path / "bag", WANTED)
    assert read.topics == TOPICS
    assert [list(message.sequence) for message in read.by_topic["/strain"]] == [[5, 5], [10, 10], [15, 15]]
    assert read.by_topic["/palm_pose"][1].pose.position.x == pose(10).pose.position.x


def test_the_bag_is_closed_on_errors(tmp_path):
    def interrupted():
        with BagWriter(tmp_path / "bag", TOPICS) as bag:
            bag.write("/strain", START, raw("strain", strain(5)))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    read = read_messages(tmp_path / "bag", WANTED)
    assert len(read.by_topic["/strain"]) == 1
    assert read.notes() == []


def test_an_existing_bag_is_not_overwritten(tmp_path):
    BagWriter(tmp_path / "bag", TOPICS).__exit__(None, None, None)
    with pytest.raises(ScanError, match="bag: could not create the bag, "):
        BagWriter(tmp_path / "bag", TOPICS)
