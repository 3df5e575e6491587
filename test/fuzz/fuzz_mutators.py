"""Seeded mutations of files: what damage, mistakes and malice do to bytes and to text."""

from __future__ import annotations

import random
import re
from collections.abc import Callable

HOSTILE_VALUES = (
    "nan", "inf", "-inf", ".inf", "1e300", "-1e300", "1e-300", "1e400", "0", "-1", "-0.0", "4294967295",
    "99999999999999999999", "1" * 5000, "0x10", "010", "1_0", "3e-3", ".5", "-pi", "2*pi", "1:30", "1,5",
    "''", '"', "null", "~", "true", "no", "[]", "{}", "[[1]]", "{a: 1}", "!!binary aGk=", "!!python/none x",
    "&a [*a]", "*a", "?", "|", "%", "[/bold]", "$x_{", "\x00", "\x1b[31m", "\ud7ff", "\u0661", "x" * 10_000,
    "../../x",
)  # fmt: skip

HOSTILE_LINES = (
    "", "#", "---", "...", "- - - -", "a: &a [*a]", "[" * 20_000, "{a: " * 5000, "x: 1\nx: 2", "1: 2",
    "? [1]\n: 2", "\t", ",", ",," * 2000, ";" * 50, "stamp_s", "BO_ 1 x: 8 y",
    ' SG_ a : 56|4294967295@1+ (1,0) [0|0] "" z', ' SG_ b : 0|64@1+ (0,0) [0|0] "" z',
    ' SG_ c m0 : 4294967295|1@1+ (1e400,nan) [0|0] "" z', "BO_ 4294967295 y: 4294967295 z",
    'BA_DEF_ "x" INT 0 0;', 'VAL_ 1 x 0 "y";', "SIG_VALTYPE_ 256 gauge_1 : 2;",
    "(1700000000.000000) can0 100##" + "0" * 200, "(nan) can0 100#00", "(1e300) can0 FFFFFFFFF#00",
)  # fmt: skip

_NUMBER = re.compile(r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
_WORD = re.compile(r"[A-Za-z_]\w*")

_SEPARATORS = (
    (b",", b";"), (b".", b","), (b":", b""), (b" ", b"\t"), (b"\n", b"\r\n"), (b"\n", b"\r"), (b"[", b"("),
    (b"}", b""), (b"-", b"\xe2\x80\x93"), (b"|", b"@"), (b",", b",,"),
)  # fmt: skip

Mutation = Callable[[random.Random, bytes], bytes]


def mutated_text(rng: random.Random, content: bytes) -> bytes:
    """Text with one to four things wrong with it."""
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        content = rng.choice(_OF_TEXT)(rng, content)
    return content[:_LARGEST]


def mutated_bytes(rng: random.Random, content: bytes) -> bytes:
    """A binary file with one to four things wrong with it."""
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        content = rng.choice(_OF_BYTES)(rng, content)
    return content[:_LARGEST]


_LARGEST = 4_000_000
"""Most bytes of a mutated file."""


def _flip(rng: random.Random, content: bytes) -> bytes:
    changed = bytearray(content)
    for _ in range(rng.choice((1, 1, 1, 3, 20))):
        if changed:
            changed[rng.randrange(len(changed))] ^= rng.randrange(1, 256)
    return bytes(changed)


def _overwrite(rng: random.Random, content: bytes) -> bytes:
    size = rng.choice((1, 2, 4, 8, 64, 4096))
    filling = rng.choice((b"\x00", b"\xff", b"\x7f", bytes([rng.randrange(256)]))) * size
    start = rng.randrange(len(content) + 1)
    return content[:start] + filling + content[start + size :]


def _truncate(rng: random.Random, content: bytes) -> bytes:
    return content[: rng.randrange(len(content) + 1)]


def _cut_out(rng: random.Random, content: bytes) -> bytes:
    start, end = sorted(rng.randrange(len(content) + 1) for _ in range(2))
    return content[:start] + content[end:]


def _repeat(rng: random.Random, content: bytes) -> bytes:
    start, end = sorted(rng.randrange(len(content) + 1) for _ in range(2))
    return content[:end] + content[start:end] * rng.choice((1, 1, 2, 50)) + content[end:]


def _append(rng: random.Random, content: bytes) -> bytes:
    return content + rng.choice((bytes(1), rng.randbytes(100), bytes(5000), content[:200]))


def _swap(rng: random.Random, content: bytes) -> bytes:
    """Exchange two pages."""
    size = rng.choice((16, 512, 4096))
    pages = [content[start : start + size] for start in range(0, len(content), size)]
    if len(pages) > 1:
        one, other = rng.sample(range(len(pages)), 2)
        pages[one], pages[other] = pages[other], pages[one]
    return b"".join(pages)


def _value(rng: random.Random, content: bytes) -> bytes:
    """A number or a word becomes another one."""
    text = content.decode("utf-8", "replace")
    found = list((_NUMBER if rng.random() < 0.8 else _WORD).finditer(text))
    if not found:
        return content
    for place in sorted(
        rng.sample(found, min(len(found), rng.choice((1, 1, 2, 10)))), key=lambda m: -m.start()
    ):
        value = rng.choice(HOSTILE_VALUES)
        if rng.random() < 0.6:  # of the same kind, and merely too large or small
            value = place.group() + rng.choice(
                ("0", "1", "5", "00", "000", "e1", "e-1", "e5", "e-5", "e300", "_")
            )
        text = text[: place.start()] + value + text[place.end() :]
    return text.encode("utf-8", "replace")


def _lines(rng: random.Random, content: bytes) -> bytes:
    """Lines are lost, doubled, reordered, or new."""
    lines = content.split(b"\n")
    place = rng.randrange(len(lines))
    kind = rng.randrange(5)
    if kind == 0:
        del lines[place]
    elif kind == 1:
        lines[place:place] = [lines[place]] * rng.choice((1, 1, 3, 500))
    elif kind == 2:
        rng.shuffle(lines)
    elif kind == 3:
        lines.reverse()
    else:
        lines.insert(place, rng.choice(HOSTILE_LINES).encode())
    return b"\n".join(lines)


def _characters(rng: random.Random, content: bytes) -> bytes:
    """Separators become others, or are lost."""
    one, other = rng.choice(_SEPARATORS)
    return content.replace(one, other, rng.choice((1, 1, -1)))


def _encode(rng: random.Random, content: bytes) -> bytes:
    """The same text in another encoding."""
    text = content.decode("utf-8", "replace")
    coding = rng.choice(("utf-16", "utf-16-le", "utf-32", "utf-8-sig", "latin-1"))
    return text.encode(coding, "replace")


_OF_BYTES: tuple[Mutation, ...] = (_flip, _flip, _overwrite, _truncate, _cut_out, _repeat, _append, _swap)
_OF_TEXT: tuple[Mutation, ...] = (
    _value, _value, _value, _value, _lines, _lines, _characters, _flip, _truncate, _repeat, _encode,
)  # fmt: skip
