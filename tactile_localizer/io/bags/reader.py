"""The messages of a bag: a directory or a file, SQLite or MCAP, compressed or not, whole or damaged."""

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
_LOT = 1024
"""Messages that are decoded at once."""

_EARLIER = {
    "tactile_localizer/msg/StrainVectors": (
        "RIHS01_f1a83b22d4db4fe3d4f4952d7c8b923f86f3d1d6fa1f42eed56ed23fb9d74774"
    )
}
"""Hash of the definition without ``channels``, by type: its messages are a beginning of today's."""

MESSAGES = ("StrainVectors", "ScanStatus", "Posterior", "FeatureProbabilities")


@dataclass
class BagMessages:
    """Messages of the wanted topics, in the order in which they were received.

    Parameters
    ----------
    by_topic : what was made of the messages, by topic: an element for each, or for each lot that a
        :class:`Decoder` made something of; a topic without messages is left out
    topics : message type by topic, of all topics in the bag
    notes : one line for each thing that could not be read
    count : how many messages were read
    """

    by_topic: dict[str, list[Any]] = field(default_factory=dict)
    topics: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    count: int = 0


Keep = Callable[[Any], Any]
"""Makes of a message what is to be kept of it."""


@runtime_checkable
class Decoder(Protocol):
    """Makes what is to be kept of messages of one type, of many at once from their bytes."""

    @property
    def kind(self) -> str:
        """The type, such as ``geometry_msgs/msg/PoseStamped``."""

    def of_message(self, message: Any) -> Any:
        """From one message object, where a bag's definition of the type is another."""

    def of_bytes(self, raws: Sequence[bytes]) -> Any:
        """From the bytes of messages (CDR, little-endian)."""


def read_messages(path: str | Path, wanted: Mapping[str, Keep | Decoder]) -> BagMessages:
    """Read the messages of some topics. A bag that is damaged is read up to the damage, and its notes say so.

    Parameters
    ----------
    path : a directory with or without metadata, or one file: ``*.mcap``, ``*.db3``, either with ``.zstd``
    wanted : by topic, what is to be kept of a message, or a :class:`Decoder` of many

    Raises
    ------
    ScanError
        There is no such bag, or nothing of it can be read.
    """
    path = Path(path)
    if not path.exists():
        raise ScanError(f"{path}: expected a bag, found none")
    files = _storage_files(path)
    # rosbags would not look at a log that a recorder which died has left.
    if not any(Path(f"{file}-wal").exists() for file in files) and path.suffix not in _COMPRESSED:
        messages = BagMessages()
        try:
            _read(path, wanted, messages)
        except SceneError:
            raise
        except Exception as error:  # rosbags raises whatever damaged bytes lead to
            damage = _one_line(error)
        else:
            return messages
    else:
        damage = ""
    return _read_damaged(path, files, wanted, damage)


def typestore() -> Typestore:
    """ROS 2 Jazzy's messages and this package's own, for writing bags and for bags without definitions."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for name in MESSAGES:
        text = resource_path(f"msg/{name}.msg").read_text(encoding="utf-8")
        store.register(get_types_from_msg(text, f"tactile_localizer/msg/{name}"))
    return store


def _read(path: Path, wanted: Mapping[str, Keep | Decoder], messages: BagMessages) -> None:
    own = typestore()
    with AnyReader([path], default_typestore=own) as reader:
        messages.topics.update({connection.topic: connection.msgtype for connection in reader.connections})
        connections = [connection for connection in reader.connections if connection.topic in wanted]
        if not connections:
            return
        for connection, stored in _lots(reader, connections):
            # A file of a bag that compresses each message does not say so itself.
            raws = [zstd.decompress(raw) if raw[:4] == _ZSTD_MAGIC else raw for raw in stored]
            keep, kind = wanted[connection.topic], connection.msgtype
            kept = messages.by_topic.setdefault(connection.topic, [])
            if (
                isinstance(keep, Decoder)
                and keep.kind == kind
                and reader.typestore.hash_rihs01(kind) in (own.hash_rihs01(kind), _EARLIER.get(kind))
                and all(raw[:2] == _LITTLE_ENDIAN for raw in raws if len(raw) > 1)
            ):
                kept.append(keep.of_bytes(raws))
            else:
                of_message = keep.of_message if isinstance(keep, Decoder) else keep
                kept += (of_message(reader.deserialize(raw, kind)) for raw in raws)
            messages.count += len(raws)


def _lots(reader: AnyReader, connections: list[Connection]) -> Iterator[tuple[Connection, list[bytes]]]:
    """The bytes of messages, many of one topic at a time, each topic's in their order."""
    lots: dict[int, tuple[Connection, list[bytes]]] = {}
    damage: Exception | None = None
    try:
        for connection, _, raw in reader.messages(connections):
            _, raws = lots.setdefault(id(connection), (connection, []))
            raws.append(raw)
            if len(raws) == _LOT:
                yield lots.pop(id(connection))
    except Exception as error:  # what came before it counts
        damage = error
    yield from lots.values()
    if damage is not None:
        raise damage


def _read_damaged(
    path: Path, files: list[Path], wanted: Mapping[str, Keep | Decoder], damage: str
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
        raise ScanError(f"{path}: expected a bag that can be read, {damage or messages.notes[0]}")
    return messages


def _storage_files(path: Path) -> list[Path]:
    """The bag's storage files, in the order of its metadata where that can be read, else of their names."""
    if not path.is_dir():
        return [path] if _is_storage(path) else []
    found = sorted(filter(_is_storage, path.iterdir()), key=_natural)
    names = _listed(path)
    return sorted(found, key=lambda file: names.index(file.name) if file.name in names else len(names))


def _listed(path: Path) -> list[str]:
    """Names of the storage files in a bag's metadata, where that can be read."""
    try:
        metadata = parse_yaml((path / "metadata.yaml").read_text(encoding="utf-8"))
        return [Path(name).name for name in metadata["rosbag2_bagfile_information"]["relative_file_paths"]]
    except (OSError, UnicodeDecodeError, yaml.YAMLError, KeyError, TypeError):
        return []


def _natural(file: Path) -> list[str | int]:
    """Orders bag_2 before bag_10."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", file.name)]


def _is_storage(file: Path) -> bool:
    return file.suffix in _STORAGE or (file.suffix in _COMPRESSED and Path(file.stem).suffix in _STORAGE)


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
