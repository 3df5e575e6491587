"""Decoding of messages of bags, by the definitions in the bag, in a folder, or of ROS 2 and this package."""

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import zstandard
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from tactile_localizer.errors import ScanError, SceneError, in_one_line, refusing
from tactile_localizer.io.bags.storage import Contents, Topic, read_storage
from tactile_localizer.io.whole_file import open_file
from tactile_localizer.resources import resource_path

MESSAGES = ("StrainVectors", "ScanStatus", "Posterior")
_ZSTD = b"\x28\xb5\x2f\xfd"
"""First bytes of a compressed message."""
_MOST_BYTES = 2**26
"""Largest compressed message of unknown size, bytes."""
_REPORT_EVERY = 1000
"""Messages between two reports of the progress."""
_IDL = "=" * 80 + "\nIDL: "
"""Line above each of several definitions."""


class Wanted(NamedTuple):
    """A topic to read.

    Parameters
    ----------
    kinds : accepted message types, such as ``geometry_msgs/msg/PoseStamped``
    convert : makes the value that is kept of a message and its time of receipt, ns; ``None`` is not kept
    """

    kinds: tuple[str, ...]
    convert: Callable[[Any, int], Any]


class Received(NamedTuple):
    """What is kept of a message, and the time of its receipt, ns."""

    topic: str
    received_ns: int
    value: Any


@dataclass
class BagMessages:
    """Converted messages in the order of receipt.

    Parameters
    ----------
    received : of the wanted topics
    topics : message type by topic, of all topics in the bag
    invalid : number of messages that cannot be decoded or converted, and the first reason, by topic
    incomplete : a line for each file that is not whole
    """

    received: list[Received]
    topics: dict[str, str]
    invalid: dict[str, list[Any]]
    incomplete: list[str]

    def notes(self) -> list[str]:
        """One line per file that is not whole, and per topic with invalid messages."""
        valid = Counter(each.topic for each in self.received)
        return self.incomplete + [
            f"skipped {count} of {count + valid[topic]} messages of {topic}: {reason}"
            for topic, (count, reason) in self.invalid.items()
        ]


def absolute(topic: str) -> str:
    """A topic as ROS names it; programs that write bags often leave out the first slash."""
    return f"/{topic.lstrip('/')}"


def read_messages(
    path: str | Path,
    wanted: Mapping[str, Wanted],
    definitions: str | Path | None = None,
    progress: Callable[[str, float], None] = lambda text, fraction: None,
) -> BagMessages:
    """Read the messages of some topics; others may be of any kind. One that cannot be converted is counted.

    Parameters
    ----------
    path : a folder, with or without ``metadata.yaml``, or one file: ``*.mcap``, ``*.db3``
    wanted : topics to read, which begin with a slash
    definitions : folder of ``.msg`` files, for types that neither the bag nor ROS 2 defines
    progress : called with a description of the work and the completed fraction

    Raises
    ------
    ScanError
        There is no such bag, it is damaged or was not closed, or a wanted topic has another message type, or
        one without a definition.
    """
    path = Path(path)
    topics, messages, incomplete = _stored(path, wanted)
    found = BagMessages([], {absolute(topic.name): topic.kind for topic in topics}, {}, incomplete)
    decoders: dict[Topic, Callable[[bytes], Any]] = {}
    for number, (topic, received_ns, raw) in enumerate(messages):
        if number % _REPORT_EVERY == 0:
            progress(f"reading {path}", number / len(messages))
        name = absolute(topic.name)
        if topic not in decoders:
            if topic.kind not in (kinds := wanted[name].kinds):
                raise ScanError(f"{path} topic {name}: expected {' or '.join(kinds)}, found {topic.kind}")
            decoders[topic] = _decoder(path, topic, definitions)
        try:
            value = wanted[name].convert(decoders[topic](raw), received_ns)
        except SceneError:
            raise
        except Exception as error:  # rosbags raises many types too
            found.invalid.setdefault(name, [0, in_one_line(error)])[0] += 1
        else:
            found.received.extend(() if value is None else (Received(name, received_ns, value),))
    return found


def _stored(path: Path, wanted: Mapping[str, Wanted]) -> Contents:
    """The undecoded messages of a bag; errors as :func:`read_messages`."""
    try:
        return read_storage(path, lambda name: absolute(name) in wanted)
    except ScanError:
        raise
    except Exception as error:  # the libraries raise many types of exceptions on damaged bytes
        repair = "`ros2 bag reindex`, `mcap recover` or sqlite3 `.recover` may repair it"
        raise ScanError(f"{path}: expected a readable bag, {in_one_line(error)}; {repair}") from None


def typestore() -> Typestore:
    """Message types of ROS 2 Jazzy and of this package, for writing bags and bags without definitions."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for name in MESSAGES:
        text = resource_path(f"msg/{name}.msg").read_text(encoding="utf-8")
        store.register(get_types_from_msg(text, f"tactile_localizer/msg/{name}"))
    return store


def _decoder(path: Path, topic: Topic, definitions: str | Path | None) -> Callable[[bytes], Any]:
    """Function that decodes a message of a topic.

    The definition in the bag is used, whose types differ between releases; what it lacks is that of
    ``definitions``, or of ROS 2 and this package.
    """
    reason = "none, as in all bags of Foxy and Humble"
    store = get_typestore(Stores.EMPTY)
    try:
        store.register(_types_in(topic) if topic.definition else {})
        store.get_msgdef(topic.kind)
    except Exception as error:  # as above, and KeyError: a type is not defined
        reason = in_one_line(error) if topic.definition else reason
        store = get_typestore(Stores.EMPTY)
        store.register(typestore().fielddefs | _types_below(definitions, topic.kind))
    try:
        store.get_msgdef(topic.kind)
    except KeyError as missing:
        expected = f"a definition of {missing.args[0]} in the bag"
        advice = "--definitions FOLDER reads .msg files"
        where = f"{path} topic {absolute(topic.name)}"
        raise ScanError(f"{where}: expected {expected}, found {reason}; {advice}") from None

    def decode(raw: bytes) -> Any:
        if raw[:4] == _ZSTD:
            raw = zstandard.decompress(raw, max_output_size=_MOST_BYTES)
        return store.deserialize_cdr(raw, topic.kind)

    return decode


def _types_in(topic: Topic) -> dict[str, Any]:
    """Types that the definition of a topic's messages has."""
    definition = _with_plain_ends(topic.definition)
    if topic.language == "ros2msg":
        return get_types_from_msg(definition, topic.kind)
    texts = definition.split(_IDL)
    parts = [text.partition("\n")[2] for text in texts[1:]] or texts
    return {name: each for text in parts for name, each in get_types_from_idl(text).items()}


def _with_plain_ends(definition: str) -> str:
    """A definition whose lines end as rosbags reads them, and begin without the mark of a Windows editor."""
    return definition.removeprefix("\ufeff").replace("\r\n", "\n")


def _types_below(folder: str | Path | None, kind: str) -> dict[str, Any]:
    """Types of the ``.msg`` files below a folder: ``skin_msgs/msg/Skin.msg``, or of the package of ``kind``.

    Raises
    ------
    ScanError
        There is none, or one cannot be read.
    """
    if folder is None:
        return {}
    types: dict[str, Any] = {}
    for path in sorted(Path(folder).rglob("*.msg")):
        package = path.parent.parent.name if path.parent.name == "msg" else kind.partition("/")[0]
        expected = f"{path}: expected a message definition"
        with refusing(expected, ScanError, Exception), open_file(path) as file:
            text = _with_plain_ends(file.read().decode(errors="replace"))  # not UTF-8: in comments
            types |= get_types_from_msg(text, f"{package}/msg/{path.stem}")
    if not types:
        raise ScanError(f"{folder}: expected a folder of .msg files, found none")
    return types
