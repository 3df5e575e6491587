"""Files of a bag, SQLite or MCAP: their topics, and undecoded messages in the order of receipt.

Only wanted topics are read, whatever else is in the bag. What a file promises and does not hold is an error.
"""

import os
import re
import shutil
import sqlite3
import struct
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from itertools import chain, pairwise
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO, NamedTuple

import yaml
import zstandard
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader, make_reader

from tactile_localizer.errors import ScanError, listed
from tactile_localizer.io.recording import BAG_EXTENSIONS

_METADATA = "metadata.yaml"
_EXPECTED = "expected a bag (*.mcap, *.db3, or a folder of them), found"
_ROS_1 = "one of ROS 1 (rosbags-convert makes a bag of ROS 2)"
_PARTS = (
    re.compile(r"(?P<number>\d+)_(?P<bag>.*)_\d{4}_\d\d_\d\d-\d\d_\d\d_\d\d\.[^_]*"),
    re.compile(r"(?P<bag>.*)_(?P<number>\d+)\.[^_]*"),
)
"""Names of the files of a bag in parts, which rosbag2 numbers: since Lyrical, and before."""
_MCAP = b"\x89MCAP0\r\n"
"""First and last bytes of an MCAP file; a recorder that is killed does not write the last ones."""
_JUMP_NS = 500_000_000
"""ns by which a time of receipt is earlier than the one before in its topic where the clock was set back."""
_LOG_HEADER_BYTES, _PAGE_HEADER_BYTES = 32, 24
"""Of a write-ahead log of SQLite, and of each page in it."""


class Topic(NamedTuple):
    """A topic of a bag.

    Parameters
    ----------
    name, kind : topic and message type, such as ``geometry_msgs/msg/PoseStamped``
    language, definition : ``ros2msg`` or ``ros2idl``, and the definition of the type; empty: there is none
    """

    name: str
    kind: str
    language: str = ""
    definition: str = ""


class Message(NamedTuple):
    """A message as stored, and the time of its receipt, ns."""

    topic: Topic
    received_ns: int
    raw: bytes


class Contents(NamedTuple):
    """All topics of a bag, messages of the wanted ones, and a line for each file that is not whole."""

    topics: list[Topic]
    messages: list[Message]
    notes: list[str]


IsWanted = Callable[[str], bool]


def read_storage(path: Path, is_wanted: IsWanted) -> Contents:
    """All topics of a bag, and the messages of those that are wanted by name, in the order of receipt.

    Parameters
    ----------
    path : a file, or a folder of files with or without ``metadata.yaml``

    Raises
    ------
    Exception
        The bag is damaged or incomplete; the libraries raise many types.
    """
    files, promised, missing = _files(path) if path.is_dir() else ([path], {}, [])
    read = [_read_file(file, is_wanted) for file in files]
    topics, messages, notes = (list(chain.from_iterable(each)) for each in zip(*read, strict=True))
    _require_all(promised, messages, is_wanted)
    return Contents(topics, _in_order(messages), missing + notes)


def _files(folder: Path) -> tuple[list[Path], dict[str, int], list[str]]:
    """Files of a bag in their order, numbers of messages by topic that the metadata promise, and notes."""
    there = [path for path in folder.iterdir() if path.name.lower().endswith(BAG_EXTENSIONS)]
    there.sort(key=lambda path: ([int(number) for number in re.findall(r"\d+", path.name)], path.name))
    if (folder / _METADATA).is_file():
        names, promised = _metadata(folder / _METADATA)
        others = [path.name for path in there if path.name not in names]
        if absent := [name for name in names if not (folder / name).is_file()]:
            found = (
                f"found {listed(others)}; remove it, and they are read without" if others else "found none"
            )
            raise ScanError(f"{folder}: expected {listed(absent)}, which {_METADATA} names, {found}")
        notes = [f"{_METADATA} does not name {listed(others)}: left out"] if others else []
        return [folder / name for name in names], promised, notes
    if not there:
        raise ScanError(f"{folder}: {_EXPECTED} none")
    parts = (next(filter(None, (name.fullmatch(path.name) for name in _PARTS)), None) for path in there)
    notes = [
        f"there is no file between {one[0]} and {other[0]}"
        for one, other in pairwise(filter(None, parts))
        if one["bag"] == other["bag"] and int(other["number"]) > int(one["number"]) + 1
    ]
    return there, {}, notes


def _metadata(path: Path) -> tuple[list[str], dict[str, int]]:
    """Names of the files, and numbers of messages by topic."""
    try:
        about = yaml.safe_load(path.read_bytes())["rosbag2_bagfile_information"]
        names = [PurePath(name).name for name in about["relative_file_paths"]]
        counts = about["topics_with_message_count"]
        return names, {each["topic_metadata"]["name"]: int(each["message_count"]) for each in counts}
    except (yaml.YAMLError, KeyError, TypeError, ValueError, RecursionError):
        raise ValueError(f"{path.name} is damaged; remove it, and the files are read without") from None


def _require_all(promised: Mapping[str, int], messages: Sequence[Message], is_wanted: IsWanted) -> None:
    found = Counter(message.topic.name for message in messages)
    for topic, count in promised.items():
        if is_wanted(topic) and found[topic] < count:
            raise ValueError(f"{count} messages of {topic} were recorded, found {found[topic]}")


def _in_order(messages: list[Message]) -> list[Message]:
    """Messages in the order of receipt, also where the clock of the recorder was set back."""
    newest_ns: dict[str, int] = {}
    jumps = Counter[str]()
    keys = []
    for topic, received_ns, _ in messages:
        jumps[topic.name] += received_ns < newest_ns.get(topic.name, received_ns) - _JUMP_NS
        newest_ns[topic.name] = received_ns
        keys.append((jumps[topic.name], received_ns))
    return [messages[each] for each in sorted(range(len(keys)), key=keys.__getitem__)]


def _read_file(path: Path, is_wanted: IsWanted) -> Contents:
    suffix = path.suffix.lower()
    if not (path.is_file() and path.name.lower().endswith(BAG_EXTENSIONS)):
        other = _ROS_1 if suffix == ".bag" else "another file"
        raise ScanError(f"{path}: {_EXPECTED} {other if path.exists() else 'none'}")
    with path.open("rb") as file:
        if suffix == ".zstd":
            with TemporaryDirectory() as folder:
                return _read_file(_unpacked(file, Path(folder, path.stem)), is_wanted)
        if suffix == ".mcap":
            return _read_mcap(file, is_wanted)
    with _recovered(path) as (whole, notes):
        return _read_sqlite(whole, is_wanted)._replace(notes=notes)


def _unpacked(packed: BinaryIO, path: Path) -> Path:
    """Path of the unpacked file, after it is written."""
    unpacker = zstandard.ZstdDecompressor().decompressobj()
    with path.open("wb") as plain:
        while block := packed.read(2**20):
            plain.write(unpacker.decompress(block))
    if not unpacker.eof or unpacker.unused_data:
        raise ValueError("the compressed file is cut short, or has more than one part")
    return path


def _read_mcap(file: BinaryIO, is_wanted: IsWanted) -> Contents:
    reader = make_reader(file, validate_crcs=True)
    file.seek(-len(_MCAP), os.SEEK_END)
    is_whole = file.read() == _MCAP
    summary = reader.get_summary() if is_whole else None
    topics: dict[int, Topic] = {}
    promised = Counter[str]()

    def topic_of(channel: Any, schema: Any) -> Topic:
        if channel.id not in topics:
            kind, language, text = (schema.name, schema.encoding, schema.data) if schema else ("", "", b"")
            if channel.message_encoding != "cdr":
                kind += f" in {channel.message_encoding}"
            topics[channel.id] = Topic(channel.topic, kind, language, text.decode(errors="replace"))
        return topics[channel.id]

    if summary is not None:
        counts = summary.statistics.channel_message_counts if summary.statistics else {}
        for number, channel in summary.channels.items():
            topic_of(channel, summary.schemas.get(channel.schema_id))
            promised[channel.topic] += counts.get(number, 0)
    if summary is None or not summary.chunk_indexes or not topics:  # no index
        file.seek(0)
        reader = NonSeekingReader(file, validate_crcs=True)
    wanted = {topic.name for topic in topics.values() if is_wanted(topic.name)} if topics else None
    messages = []
    with suppress(*() if is_whole else (EndOfFile, struct.error)):
        for schema, channel, message in reader.iter_messages(wanted, log_time_order=False):
            topic = topic_of(channel, schema)
            if is_wanted(topic.name):
                messages.append(Message(topic, message.log_time, message.data))
    _require_all(promised, messages, is_wanted)
    note = f"{PurePath(file.name).name} ends within the recording: the last messages are missing"
    return Contents(list(topics.values()), messages, [] if is_whole else [note])


def _read_sqlite(path: Path, is_wanted: IsWanted) -> Contents:
    with closing(sqlite3.connect(f"{path.resolve().as_uri()}?immutable=1", uri=True)) as database:
        query, definitions = database.execute, {}
        if query("SELECT 1 FROM sqlite_master WHERE name = 'message_definitions'").fetchone():
            rows = query("SELECT topic_type, encoding, encoded_message_definition FROM message_definitions")
            definitions = {kind: texts for kind, *texts in rows}
        rows = query("SELECT id, name, type FROM topics")
        topics = {number: Topic(name, kind, *definitions.get(kind, ())) for number, name, kind in rows}
        wanted = [number for number, topic in topics.items() if is_wanted(topic.name)]
        where = f"WHERE topic_id IN ({', '.join('?' * len(wanted))})"
        rows = query(f"SELECT topic_id, timestamp, data FROM messages {where} ORDER BY id", wanted)
        messages = [Message(topics[number], received_ns, raw) for number, received_ns, raw in rows]
        # A damaged page hides rows of the table or of its index, but not of both.
        known = "NOT INDEXED WHERE topic_id IN (SELECT id FROM topics)"
        (stored,) = query(f"SELECT count(*) FROM messages {known}").fetchone()
        (indexed,) = query("SELECT count(*) FROM messages").fetchone()
        if stored != indexed:
            raise ValueError(f"{indexed} messages were recorded, found {stored}")
    return Contents(list(topics.values()), messages, [])


@contextmanager
def _recovered(path: Path) -> Iterator[tuple[Path, list[str]]]:
    """The database, or a copy with what a killed recorder left in a log or a journal beside it; and notes.

    Raises
    ------
    ValueError
        The log has transactions that cannot be read.
    """
    log = Path(f"{path}-wal")
    left = [each for each in (log, Path(f"{path}-journal")) if each.is_file() and each.stat().st_size]
    if not left:
        yield path, []
        return
    with TemporaryDirectory() as folder:
        for each in (path, *left):
            shutil.copyfile(each, Path(folder, each.name))
        copy = Path(folder, path.name)
        with closing(sqlite3.connect(copy)) as database:
            (page_bytes,) = database.execute("PRAGMA page_size").fetchone()
            _, recovered, _ = database.execute("PRAGMA wal_checkpoint").fetchone()
        yield copy, _log_notes(log, page_bytes, max(recovered, 0)) if log in left else []


def _log_notes(log: Path, page_bytes: int, recovered: int) -> list[str]:
    """A line about a log that ends within a transaction, as that of a recorder that was killed can.

    Raises
    ------
    ValueError
        A later transaction than the ``recovered`` pages is whole.
    """
    content, step = log.read_bytes(), _PAGE_HEADER_BYTES + page_bytes
    starts = range(_LOG_HEADER_BYTES, len(content) - page_bytes, step)
    headers = [content[at : at + _PAGE_HEADER_BYTES] for at in starts]
    # Pages with another salt are older than the log; one with a number ends a transaction.
    pages = [number for number, header in enumerate(headers, 1) if header[8:16] == content[16:24]]
    ends = [number for number in pages if any(headers[number - 1][4:8])]
    if recovered < max([*ends, min(len(headers), 1)]):
        raise ValueError(f"{log.name} is damaged: {recovered} of {len(headers)} pages can be read")
    if recovered < max(pages, default=0) or (len(content) - _LOG_HEADER_BYTES) % step:
        return [f"{log.name} ends within a transaction: the last messages are missing"]
    return []
