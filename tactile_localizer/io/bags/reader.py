"""Reading messages from bags (SQLite or MCAP) with rosbags."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from tactile_localizer.errors import ScanError, SceneError
from tactile_localizer.resources import resource_path

MESSAGES = ("StrainVectors", "ScanStatus", "Posterior")


class Wanted(NamedTuple):
    """A topic to read.

    Parameters
    ----------
    kind : expected message type, such as ``geometry_msgs/msg/PoseStamped``
    convert : makes the value that is kept of a message and its time of receipt, ns; ``None`` is not kept
    """

    kind: str
    convert: Callable[[Any, int], Any]


@dataclass
class BagMessages:
    """Converted messages by topic, in order of receipt.

    Parameters
    ----------
    by_topic : values by wanted topic; topics without messages are missing
    topics : message type by topic, of all topics in the bag
    invalid : number of messages that cannot be decoded or converted, and the first reason, by topic
    """

    by_topic: dict[str, list[Any]] = field(default_factory=dict)
    topics: dict[str, str] = field(default_factory=dict)
    invalid: dict[str, list[Any]] = field(default_factory=dict)

    def notes(self) -> list[str]:
        """One line per topic with invalid messages."""
        return [
            f"skipped {count} of {count + len(self.by_topic.get(topic, ()))} messages of {topic}: {reason}"
            for topic, (count, reason) in self.invalid.items()
        ]


def read_messages(path: str | Path, wanted: Mapping[str, Wanted]) -> BagMessages:
    """Read the messages of some topics. A message that cannot be converted is counted.

    Parameters
    ----------
    path : a directory with ``metadata.yaml``, or one file: ``*.mcap``, ``*.db3``
    wanted : topics to read

    Raises
    ------
    ScanError
        There is no such bag, it is damaged or was not closed, or a wanted topic has another message type.
    """
    path = Path(path)
    found = BagMessages()
    try:
        if not (path.is_dir() or path.is_file()):
            raise ScanError(f"{path}: expected a bag (*.mcap, *.db3, or a directory of them), found none")
        with AnyReader([path], default_typestore=typestore()) as reader:
            found.topics.update({each.topic: each.msgtype for each in reader.connections})
            connections = [each for each in reader.connections if each.topic in wanted]
            expected: Counter[str] = Counter()
            for each in connections:
                expected[each.topic] += each.msgcount
                if each.msgtype != wanted[each.topic].kind:
                    kind = wanted[each.topic].kind
                    raise ScanError(f"{path} topic {each.topic}: expected {kind}, found {each.msgtype}")
            for connection, received_ns, raw in reader.messages(connections) if connections else ():
                topic = connection.topic
                expected[topic] -= 1
                try:
                    message = reader.deserialize(raw, connection.msgtype)
                    value = wanted[topic].convert(message, received_ns)
                    found.by_topic.setdefault(topic, []).extend(() if value is None else (value,))
                except SceneError:
                    raise
                except Exception as error:  # rosbags raises many types of exceptions on damaged bytes
                    found.invalid.setdefault(topic, [0, _one_line(error)])[0] += 1
            if missing := {topic: count for topic, count in expected.items() if count}:
                raise ValueError(f"could not read so many messages of its topics: {missing}")
    except (ScanError, SceneError):
        raise
    except Exception as error:  # as above
        repair = "`ros2 bag reindex`, `mcap recover` or sqlite3 `.recover` may repair it"
        raise ScanError(f"{path}: expected a readable bag, {_one_line(error)}; {repair}") from None
    return found


def typestore() -> Typestore:
    """Message types of ROS 2 Jazzy and of this package, for writing bags and bags without definitions."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for name in MESSAGES:
        text = resource_path(f"msg/{name}.msg").read_text(encoding="utf-8")
        store.register(get_types_from_msg(text, f"tactile_localizer/msg/{name}"))
    return store


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:300] or type(error).__name__
