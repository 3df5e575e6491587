"""Reading messages from bags: directories or files, SQLite or MCAP, compressed or not, even damaged."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import yaml
from backports import zstd
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from tactile_localizer.errors import ScanError, SceneError
from tactile_localizer.io.bags.repair import repair
from tactile_localizer.io.yaml_file import parse_yaml
from tactile_localizer.resources import resource_path

_STORAGE = (".mcap", ".db3")
_COMPRESSED = (".zstd", ".zst")
_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
_LITTLE_ENDIAN = b"\x00\x01"
_BLOCK_MESSAGES = 1024
"""Messages of one topic decoded together; larger blocks were not measurably faster."""

_EARLIER_DEFINITIONS = {
    "tactile_localizer/msg/StrainVectors": (
        "RIHS01_f1a83b22d4db4fe3d4f4952d7c8b923f86f3d1d6fa1f42eed56ed23fb9d74774"
    )
}
"""Hash of the definition before ``channels`` was appended, by type; its messages have the same layout."""

MESSAGES = ("StrainVectors", "ScanStatus", "Posterior")


@dataclass
class BagMessages:
    """Converted messages of the requested topics, in order of receipt.

    Parameters
    ----------
    by_topic : converted messages by topic, one element per message or per block of a :class:`Decoder`;
        topics without messages are missing
    topics : message type by topic, of all topics in the bag
    notes : one line for each part that could not be read
    count : number of messages read
    """

    by_topic: dict[str, list[Any]] = field(default_factory=dict)
    topics: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    count: int = 0


Converter = Callable[[Any], Any]
"""Converts a message object to the value that is kept."""


@runtime_checkable
class Decoder(Protocol):
    """Converts messages of one type, many at once from their serialised bytes."""

    @property
    def kind(self) -> str:
        """Message type, such as ``geometry_msgs/msg/PoseStamped``."""

    def of_message(self, message: Any) -> Any:
        """Convert one message object; used if the bag's definition of the type differs."""

    def of_bytes(self, raws: Sequence[bytes]) -> Any:
        """Convert serialised messages (CDR, little-endian)."""


def read_messages(path: str | Path, wanted: Mapping[str, Converter | Decoder]) -> BagMessages:
    """Read the messages of some topics. A damaged bag is read up to the damage, which the notes report.

    Parameters
    ----------
    path : a directory with or without metadata, or one file: ``*.mcap``, ``*.db3``, either with ``.zstd``
    wanted : converter or :class:`Decoder` by topic

    Raises
    ------
    ScanError
        There is no such bag, or nothing in it can be read.
    """
    path = Path(path)
    if not path.exists():
        raise ScanError(f"{path}: expected a bag, found none")
    files = _storage_files(path)
    # rosbags ignores the write-ahead log that a killed recorder leaves behind.
    if not any(Path(f"{file}-wal").exists() for file in files) and path.suffix not in _COMPRESSED:
        messages = BagMessages()
        try:
            _read(path, wanted, messages)
        except SceneError:
            raise
        except Exception as error:  # rosbags raises many types of exceptions on damaged bytes
            damage = _one_line(error)
        else:
            return messages
    else:
        damage = ""
    return _read_damaged(path, files, wanted, damage)


def typestore() -> Typestore:
    """Message types of ROS 2 Jazzy and of this package, for writing bags and bags without definitions."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for name in MESSAGES:
        text = resource_path(f"msg/{name}.msg").read_text(encoding="utf-8")
        store.register(get_types_from_msg(text, f"tactile_localizer/msg/{name}"))
    return store


def _read(path: Path, wanted: Mapping[str, Converter | Decoder], messages: BagMessages) -> None:
    known = typestore()
    with AnyReader([path], default_typestore=known) as reader:
        messages.topics.update({connection.topic: connection.msgtype for connection in reader.connections})
        connections = [connection for connection in reader.connections if connection.topic in wanted]
        if not connections:
            return
        for connection, stored in _blocks(reader, connections):
            # Compression of single messages is recorded in the metadata only, which may be lost.
            raws = [zstd.decompress(raw) if raw[:4] == _ZSTD_MAGIC else raw for raw in stored]
            convert, kind = wanted[connection.topic], connection.msgtype
            converted = messages.by_topic.setdefault(connection.topic, [])
            if (
                isinstance(convert, Decoder)
                and convert.kind == kind
                and reader.typestore.hash_rihs01(kind)
                in (known.hash_rihs01(kind), _EARLIER_DEFINITIONS.get(kind))
                and all(raw[:2] == _LITTLE_ENDIAN for raw in raws if len(raw) > 1)
            ):
                converted.append(convert.of_bytes(raws))
            else:
                of_message = convert.of_message if isinstance(convert, Decoder) else convert
                converted += (of_message(reader.deserialize(raw, kind)) for raw in raws)
            messages.count += len(raws)


def _blocks(reader: AnyReader, connections: list[Connection]) -> Iterator[tuple[Connection, list[bytes]]]:
    """Serialised messages in blocks of one topic each; those of a topic stay in order."""
    blocks: dict[int, tuple[Connection, list[bytes]]] = {}
    damage: Exception | None = None
    try:
        for connection, _, raw in reader.messages(connections):
            _, raws = blocks.setdefault(id(connection), (connection, []))
            raws.append(raw)
            if len(raws) == _BLOCK_MESSAGES:
                yield blocks.pop(id(connection))
    except Exception as error:  # first return the messages before the damage
        damage = error
    yield from blocks.values()
    if damage is not None:
        raise damage


def _read_damaged(
    path: Path, files: list[Path], wanted: Mapping[str, Converter | Decoder], damage: str
) -> BagMessages:
    messages = BagMessages()
    if not files:
        found = "found a directory without" if path.is_dir() and not _listed(path) else damage
        raise ScanError(f"{path}: expected a bag (*.mcap, *.db3, or a directory of them), {found}")
    for file in files:
        before = messages.count
        with tempfile.TemporaryDirectory() as folder:
            try:
                _read(repair(file, Path(folder)), wanted, messages)
            except SceneError:
                raise
            except Exception as error:
                messages.notes.append(f"{file}: could not be read: {_one_line(error)}")
        if damage:
            messages.notes.append(f"{file}: read {messages.count - before} messages up to the damage")
    if damage:
        messages.notes.insert(0, f"{path}: the bag is damaged: {damage}")
    if not messages.topics:
        raise ScanError(f"{path}: expected a readable bag, {damage or messages.notes[0]}")
    return messages


def _storage_files(path: Path) -> list[Path]:
    """The bag's storage files, in the order of its metadata if readable, else in natural order of names."""
    if not path.is_dir():
        return [path] if _is_storage(path) else []
    found = sorted(filter(_is_storage, path.iterdir()), key=_natural)
    names = _listed(path)
    return sorted(found, key=lambda file: names.index(file.name) if file.name in names else len(names))


def _listed(path: Path) -> list[str]:
    """Names of the storage files in a bag's metadata; empty if that cannot be read."""
    try:
        metadata = parse_yaml((path / "metadata.yaml").read_text(encoding="utf-8"))
        return [Path(name).name for name in metadata["rosbag2_bagfile_information"]["relative_file_paths"]]
    except (OSError, UnicodeDecodeError, yaml.YAMLError, KeyError, TypeError):
        return []


def _natural(file: Path) -> list[str | int]:
    """Sort key that puts bag_2 before bag_10."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", file.name)]


def _is_storage(file: Path) -> bool:
    return file.suffix in _STORAGE or (file.suffix in _COMPRESSED and Path(file.stem).suffix in _STORAGE)


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
