"""Repair of bag files that a recorder left unfinished."""

import struct
import tracemalloc
from pathlib import Path

from rosbags.highlevel import AnyReader
from support.bags import slide, write_bag

from tactile_localizer.io.bags.reader import typestore
from tactile_localizer.io.bags.repair import repair

MESSAGE = 5  # opcode of a message record


def messages(path: Path) -> int:
    with AnyReader([path], default_typestore=typestore()) as reader:
        return sum(1 for _ in reader.messages())


def unfinished(folder: Path, end: bytes = b"") -> Path:
    """An MCAP file without its summary, as a recorder that was killed leaves it."""
    bag = write_bag(folder / "bag", slide(0, 200))
    (whole,) = bag.glob("*.mcap")
    data = whole.read_bytes()
    (summary,) = struct.unpack_from("<Q", data, len(data) - 28)
    cut = folder / "cut.mcap"
    cut.write_bytes(data[: summary - 13] + end)  # 13 bytes: the record that ends the data
    return cut


def test_an_unfinished_file_keeps_all_messages(tmp_path: Path) -> None:
    expected = messages(write_bag(tmp_path / "whole", slide(0, 200)))
    assert messages(repair(unfinished(tmp_path), tmp_path)) == expected


def test_a_record_that_claims_to_be_huge_takes_no_memory(tmp_path: Path) -> None:
    cut = unfinished(tmp_path, struct.pack("<BQ", MESSAGE, 1 << 33))
    tracemalloc.start()
    try:
        repair(cut, tmp_path)
        peak_bytes = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak_bytes < 10_000_000
