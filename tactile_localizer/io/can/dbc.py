"""The messages of phalanges in a DBC file.

Only these are parsed, so faults in other messages do not matter. Lines that contradict each other are
refused, and numbers by which a parser would allocate memory without limit.
"""

import copy
import logging
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeAlias

import cantools
from cantools.database.can import Database, Message

from tactile_localizer.errors import CanError, listed, refusing

# cantools logs errors that are raised below as one line.
logging.getLogger("cantools").addHandler(logging.NullHandler())

MAX_BYTES = 64
"""Data bytes of the longest CAN FD frame."""

PhalanxMessages: TypeAlias = tuple[tuple[Message, ...], ...]

Blocks: TypeAlias = list[tuple[str, re.Match[str]]]
"""Messages in the text of a DBC: name and lines."""

_TEXT = re.compile(r'"(?:\\"|[^"])*"|//.*')
_MESSAGE = re.compile(
    r"^[ \t]*BO_\s+(?P<number>\d{1,10})\s+(?P<name>\w+)\s*:\s*(?P<length>\d+)"
    r".*(?:\n(?![ \t]*(?!SG_\s)[A-Z_]+_\s).*)*",  # up to a line that begins with a keyword other than SG_
    re.MULTILINE,
)
_LONG_NAME = re.compile(r'BA_\s+"SystemMessageLongSymbol"\s+BO_\s+(\d+)\s+"([^"]*)"')
_SIGNAL = re.compile(r"\bSG_\s+(\w+)[^:]*:\s*(-?\d+)\s*\|\s*(-?\d+)")
_FLOAT = re.compile(r"\bSIG_VALTYPE_\s+(\d+)\s+(\w+)")
_MANY_VALUES = re.compile(r'\bSG_MUL_VAL_\s+\d+\s+\w+\s+\w+[^;"]*\d{6}[^;"]*;')
"""Values of a multiplexer, which a parser would list one by one."""


def read_messages(
    path: str | Path, phalanges: Sequence[str], messages: Mapping[str, Sequence[str]]
) -> PhalanxMessages:
    """Messages of each phalanx: those listed in ``messages``, or else those named after the phalanx.

    Messages of the phalanx ``index`` are ``index``, and ``index_`` with one letter or a number. A listed
    message can have another identifier than in the DBC: ``STRAIN@0x182``.

    Raises
    ------
    CanError
        The file cannot be read or is not a DBC; a phalanx has no message; a message is twice in the DBC, or
        contradicts itself.
    """
    expected = f"{path}: expected a DBC file"
    with refusing(expected, CanError, OSError):
        text = _decoded(Path(path).read_bytes())
    plain = _TEXT.sub(lambda found: " " * len(found[0]), text)
    long_names = dict(_LONG_NAME.findall(text))
    blocks = [(str(long_names.get(one["number"], one["name"])), one) for one in _MESSAGE.finditer(plain)]
    if not blocks:
        raise CanError(f"{expected}, found no messages (BO_) in it")
    chosen = _choose(phalanges, messages, [name for name, _ in blocks])
    used = dict.fromkeys(_name_of(reference) for own in chosen for reference in own)
    for name in used:
        _check(name, blocks)
    end, pieces = 0, []
    for name, block in blocks:
        if name not in used:
            pieces.append(text[end : block.start()])
            end = block.end()
    text = _MANY_VALUES.sub("", "".join([*pieces, text[end:]]))
    with refusing(expected, CanError, cantools.Error, ValueError, LookupError, TypeError, RecursionError):
        database = cantools.database.load_string(text, database_format="dbc", prune_choices=False)
    assert isinstance(database, Database)
    by_name = {message.name: message for message in database.messages}
    _check_types(plain, blocks, database.messages)
    return tuple(tuple(_resolve(by_name, reference) for reference in own) for own in chosen)


def _decoded(data: bytes) -> str:
    """Text in UTF-8 or UTF-16, or with lines in the code page in which editors of DBCs write."""
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return data.decode("utf-16", errors="replace")
    lines = []
    for line in data.removeprefix(b"\xef\xbb\xbf").splitlines():
        try:
            lines.append(line.decode())
        except UnicodeDecodeError:
            lines.append(line.decode("cp1252", errors="replace"))
    return "\n".join(lines) + "\n"


def _choose(
    phalanges: Sequence[str], messages: Mapping[str, Sequence[str]], names: Sequence[str]
) -> list[list[str]]:
    """Messages of each phalanx, as listed."""
    chosen = []
    for phalanx in phalanges:
        pattern = re.compile(re.escape(phalanx) + r"(_([A-Za-z]|\d+))?")
        named = sorted(set(filter(pattern.fullmatch, names)), key=lambda name: (len(name), name))
        own = list(messages.get(phalanx, ())) or named
        if not own:
            raise CanError(
                f"phalanx {phalanx!r}: expected a message {phalanx} or {phalanx}_a, {phalanx}_b, ... in the "
                f"DBC, or a list of its messages, found {listed(names)}"
            )
        for reference in own:
            if _name_of(reference) not in names:
                raise CanError(
                    f"phalanx {phalanx!r}: message {reference!r} is not in the DBC, which has {listed(names)}"
                )
        chosen.append(own)
    return chosen


def _name_of(reference: str) -> str:
    return reference.partition("@")[0]


def _resolve(messages: Mapping[str, Message], reference: str) -> Message:
    """A message with the identifier that its reference has, or that of the DBC."""
    name, at, identifier = reference.partition("@")
    if name not in messages:
        raise CanError(f"message {name!r}: expected its length and sender in the DBC, found it cut short")
    message = messages[name]
    if at:
        message = copy.copy(message)
        try:
            message.frame_id = int(identifier, 0)
        except ValueError:
            message.frame_id = -1
        message.is_extended_frame = message.is_extended_frame or message.frame_id > 0x7FF
        if not 0 <= message.frame_id < 1 << 29:
            raise CanError(f"message {reference!r}: expected an identifier such as 0x182 after the @")
    return message


def _check(name: str, blocks: Blocks) -> None:
    """Refuse what a parser does not look at, and sizes that it must not see."""
    lines = next(block for other, block in blocks if other == name)
    same = [(other, one) for other, one in blocks if other == name or one["number"] == lines["number"]]
    if len(same) > 1:
        found = ", ".join(f"{other} 0x{int(one['number']) & 0x1FFFFFFF:X}" for other, one in same)
        raise CanError(f"message {name!r}: expected its name and identifier once in the DBC, found {found}")
    if float(lines["length"]) > MAX_BYTES:
        raise CanError(f"message {name!r}: expected at most {MAX_BYTES} bytes, found {lines['length']:.20}")
    for signal, start, length in _SIGNAL.findall(lines[0]):
        if not (0 <= float(start) < 8 * MAX_BYTES and 0 < float(length) <= 8 * MAX_BYTES):
            raise CanError(
                f"signal {signal!r} of {name}: expected 1 to {8 * MAX_BYTES} bits within a frame, found "
                f"{length:.20} from bit {start:.20} on"
            )


def _check_types(plain: str, blocks: Blocks, messages: Sequence[Message]) -> None:
    """Refuse integers that may be floats: a type is that of no signal, but of their name or their message."""
    known = {(block["number"], signal) for _, block in blocks for signal, *_ in _SIGNAL.findall(block[0])}
    numbers = {name: block["number"] for name, block in blocks}
    for number, name in dict.fromkeys(_FLOAT.findall(plain)):
        for message in messages if (number, name) not in known else ():
            for signal in message.signals:
                is_meant = name == signal.name or number == numbers[message.name]
                if is_meant and not signal.is_float and signal.length in (32, 64):
                    raise CanError(
                        f"signal {signal.name!r} of {message.name}: expected its type in SIG_VALTYPE_, found "
                        f"that of {name!r} of message {number}, which is not in the DBC"
                    )
