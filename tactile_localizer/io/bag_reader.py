"""The messages of a bag: a directory or a file, SQLite or MCAP, compressed or not, whole or damaged."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml
from backports import zstd
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from tactile_localizer.errors import ScanError
from tactile_localizer.io.bag_repair import repair
from tactile_localizer.resources import resource_path

_STORAGE = (".mcap", ".db3")
_COMPRESSED = (".zstd", ".zst")
_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
_LITTLE_ENDIAN = b"\x00\x01"

MESSAGES = ("StrainVectors", "ScanStatus", "Posterior", "FeatureProbabilities")


@dataclass
class BagMessages:
    """Messages of the wanted topics, in the order in which they were received.

    Parameters
    ----------
    by_topic : what was made of each message, by topic; a topic without messages is left out
    topics : message type by topic, of all topics in the bag
    notes : one line for each thing that could not be read
    """

    by_topic: dict[str, list[Any]] = field(default_factory=dict)
    topics: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def __len__(self) -> int:
        return sum(map(len, self.by_topic.values()))


Keep = Callable[[Any], Any]
"""Makes of a message what is to be kept of it."""


@dataclass(frozen=True)
class QuickKeep:
    """What is to be kept of messages of one type, which is had quicker from their bytes.

    Parameters
    ----------
    kind : of the messages, such as ``geometry_msgs/msg/PoseStamped``
    of_message : from a message object, where a bag's definition of the type is another
    of_bytes : from its bytes (CDR, little-endian)
    """

    kind: str
    of_message: Keep
    of_bytes: Callable[[bytes], Any]

    def __call__(self, message: Any) -> Any:
        """As any :data:`Keep`."""
        return self.of_message(message)


def read_messages(path: str | Path, wanted: Mapping[str, Keep]) -> BagMessages:
    """Read the messages of some topics. A bag that is damaged is read up to the damage, and its notes say so.

    Parameters
    ----------
    path : a directory with or without metadata, or one file: ``*.mcap``, ``*.db3``, either with ``.zstd``
    wanted : by topic, what is to be kept of a message, perhaps as a :class:`QuickKeep`

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


def _read(path: Path, wanted: Mapping[str, Keep], messages: BagMessages) -> None:
    own = typestore()
    with AnyReader([path], default_typestore=own) as reader:
        messages.topics.update({connection.topic: connection.msgtype for connection in reader.connections})
        connections = [connection for connection in reader.connections if connection.topic in wanted]
        if not connections:
            return
        quick = {c.topic: _quick(wanted[c.topic], c.msgtype, own, reader.typestore) for c in connections}
        for connection, _, raw in reader.messages(connections):
            # A file of a bag that compresses each message does not say so itself.
            plain = zstd.decompress(raw) if raw[:4] == _ZSTD_MAGIC else raw
            of_bytes = quick[connection.topic]
            if of_bytes is not None and plain[:2] == _LITTLE_ENDIAN:
                kept = of_bytes(plain)
            else:
                kept = wanted[connection.topic](reader.deserialize(plain, connection.msgtype))
            messages.by_topic.setdefault(connection.topic, []).append(kept)


def _quick(keep: Keep, kind: str, own: Typestore, of_bag: Typestore) -> Callable[[bytes], Any] | None:
    """The quick way, where there is one and the bag defines the type as it expects."""
    if not isinstance(keep, QuickKeep) or kind != keep.kind:
        return None
    return keep.of_bytes if own.hash_rihs01(kind) == of_bag.hash_rihs01(kind) else None


def _read_damaged(path: Path, files: list[Path], wanted: Mapping[str, Keep], damage: str) -> BagMessages:
    messages = BagMessages()
    if not files:
        raise ScanError(f"{path}: expected a bag (*.mcap, *.db3, or a directory of them), {damage}")
    for file in files:
        before = len(messages)
        with tempfile.TemporaryDirectory() as folder:
            try:
                _read(repair(file, Path(folder)), wanted, messages)
            except Exception as error:
                messages.notes.append(f"{file}: could not be read: {_one_line(error)}")
        if damage:
            messages.notes.append(f"{file}: read {len(messages) - before} messages up to the damage")
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
    try:
        metadata = yaml.safe_load((path / "metadata.yaml").read_text(encoding="utf-8"))
        names = [Path(name).name for name in metadata["rosbag2_bagfile_information"]["relative_file_paths"]]
    except (OSError, UnicodeDecodeError, yaml.YAMLError, KeyError, TypeError):
        return found
    return sorted(found, key=lambda file: names.index(file.name) if file.name in names else len(names))


def _natural(file: Path) -> list[str | int]:
    """Orders bag_2 before bag_10."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", file.name)]


def _is_storage(file: Path) -> bool:
    return file.suffix in _STORAGE or (file.suffix in _COMPRESSED and Path(file.stem).suffix in _STORAGE)


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
