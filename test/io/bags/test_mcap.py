"""MCAP files by the letter of their specification, encoded here and not by the library that writes ours."""

import struct
import tracemalloc
from pathlib import Path
from zlib import crc32

import lz4.frame
import pytest
from backports import zstd

from tactile_localizer.io.bags.mcap import CHANNEL, CHUNK, DATA_END, HEADER, MAGIC, MESSAGE, messages_by_topic

COMPRESSED = {"": bytes, "zstd": zstd.compress, "lz4": lz4.frame.compress}
TOPICS = {"/strain": 1, "/palm_pose": 2, "/other": 3}


def text(value: str) -> bytes:
    return struct.pack("<I", len(value)) + value.encode()


def record(code: int, content: bytes) -> bytes:
    return struct.pack("<BQ", code, len(content)) + content


def channel(topic: str) -> bytes:
    head = struct.pack("<HH", TOPICS[topic], 0)
    return record(CHANNEL, head + text(topic) + text("cdr") + struct.pack("<I", 0))


def message(topic: str, received_ns: int, data: bytes) -> bytes:
    return record(MESSAGE, struct.pack("<HIQQ", TOPICS[topic], 0, received_ns, received_ns) + data)


def chunk(records: bytes, compression: str = "", checksum: int | None = None) -> bytes:
    stored = COMPRESSED[compression](records)
    crc = crc32(records) if checksum is None else checksum
    head = struct.pack("<QQQI", 0, 0, len(records), crc)
    return record(CHUNK, head + text(compression) + struct.pack("<Q", len(stored)) + stored)


def read(tmp_path: Path, *records: bytes) -> dict[str, list[bytes]]:
    path = tmp_path / "bag.mcap"
    header = record(HEADER, text("ros2") + text("test"))
    path.write_bytes(MAGIC + header + b"".join(records) + record(DATA_END, bytes(4)) + MAGIC)
    return messages_by_topic(path, ("/strain", "/palm_pose", "/never"))


RECORDS = [
    channel("/strain"),
    channel("/other"),
    message("/strain", 3, b"third"),
    message("/other", 1, b"nobody asked"),
    message("/strain", 1, b"first"),
    channel("/palm_pose"),
    message("/palm_pose", 2, b"pose"),
]
FOUND = {"/strain": [b"first", b"third"], "/palm_pose": [b"pose"], "/never": []}


def test_messages_without_chunks_are_read_in_the_order_of_their_receipt(tmp_path: Path) -> None:
    assert read(tmp_path, *RECORDS) == FOUND


@pytest.mark.parametrize("compression", COMPRESSED)
def test_a_channel_of_one_chunk_is_known_in_the_next(tmp_path: Path, compression: str) -> None:
    chunks = [chunk(b"".join(part), compression) for part in (RECORDS[:3], RECORDS[3:])]
    assert read(tmp_path, *chunks) == FOUND


def test_a_checksum_of_zero_is_none(tmp_path: Path) -> None:
    assert read(tmp_path, chunk(b"".join(RECORDS), checksum=0)) == FOUND


@pytest.mark.parametrize(
    ("damaged", "reason"),
    [
        (chunk(b"".join(RECORDS), checksum=7), "chunk: expected .* bytes with checksum 0x7, got others"),
        (chunk(RECORDS[0] + RECORDS[2][:-2]), "chunk: expected whole records, the last ends 2 bytes late"),
    ],
    ids=["checksum", "cut record"],
)
def test_a_damaged_chunk_is_refused(tmp_path: Path, damaged: bytes, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        read(tmp_path, damaged)


def test_what_stands_after_the_data_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "bag.mcap"
    data, summary = b"".join(RECORDS), message("/strain", 9, b"not data")
    path.write_bytes(MAGIC + data + record(DATA_END, bytes(4)) + summary + MAGIC)
    assert messages_by_topic(path, ("/strain",)) == {"/strain": FOUND["/strain"]}


def test_a_record_that_claims_to_be_huge_takes_no_memory(tmp_path: Path) -> None:
    tracemalloc.start()
    try:
        found = read(tmp_path, *RECORDS, struct.pack("<BQ", MESSAGE, 1 << 33))
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert found == FOUND
    assert most < 10_000_000
