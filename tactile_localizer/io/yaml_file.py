"""Safe reading of YAML files with user input: mappings, lists, strings, numbers and booleans only.

PyYAML follows YAML 1.1, in which ``3e-3`` is a string, ``010`` is eight, ``1:30`` is ninety, and the last of
two equal keys wins. Here numbers are decimal, and keys are unique strings. Files that are large, deeply
nested, or that expand through aliases are refused before they cost time or memory.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Hashable
from pathlib import Path
from typing import Any, TypeVar

import yaml

from tactile_localizer.errors import TactileLocalizerError

MAX_FILE_BYTES = 64 * 1024
"""Largest file that is read; a scene of five phalanges has about 1,500 bytes."""

_MAX_DEPTH = 16
"""Deepest nesting; scenes and driver parameters have four levels."""

_MAX_VALUES = 20_000
"""Most values, with aliases expanded."""

_Converted = TypeVar("_Converted")

_PREFIX = "tag:yaml.org,2002:"
_TAGS = {_PREFIX + kind for kind in ("null", "bool", "int", "float", "str", "seq", "map")}


class _Loader(yaml.SafeLoader):
    """Loader for the subset of YAML described above."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._depth = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        self._depth += 1
        if self._depth > _MAX_DEPTH:
            raise yaml.YAMLError(f"at most {_MAX_DEPTH} levels, found more")
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node

    def get_single_node(self) -> Any:
        node = super().get_single_node()
        if node is not None:
            _require_bounded(node)
        return node

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Hashable, Any]:
        keys = [key for key, _ in node.value]
        for key in keys:
            if key.tag != f"{_PREFIX}str":
                hint = "; put it in quotes" if isinstance(key, yaml.ScalarNode) else ""
                raise _error_at(key, f"a string as a key, found {_description(key)}{hint}")
        for name, count in Counter(key.value for key in keys).items():
            if count > 1:
                raise _error_at(node, f"the key {name[:40]!r} once, found it {count} times")
        return super().construct_mapping(node, deep=True)


_Loader.yaml_implicit_resolvers = {}  # replaces PyYAML's
for _tag, _pattern, _first in (
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("bool", r"(?i:yes|no|true|false|on|off)", list("yYnNtTfFoO")),
    ("int", r"[-+]?(?:0|[1-9][0-9]{0,17})", list("-+0123456789")),
    (
        "float",
        r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)",
        list("-+.0123456789"),
    ),
):  # fmt: skip
    _Loader.add_implicit_resolver(_PREFIX + _tag, re.compile(rf"(?:{_pattern})\Z", re.ASCII), _first)


def load_yaml(
    path: str | Path, what: str, error: type[TactileLocalizerError], convert: Callable[[Any], _Converted]
) -> _Converted:
    """Read a YAML file.

    Parameters
    ----------
    path : the file
    what : the expected kind of file for messages, such as ``a scene file``
    error : class of the exception to raise
    convert : makes the result of the content: mappings with strings as keys, lists, strings, numbers,
        booleans, ``None``

    Raises
    ------
    TactileLocalizerError
        As ``error``: the file is missing, cannot be read, is not YAML, exceeds the limits above, or cannot
        be converted.
    """
    path = Path(path)
    try:
        if path.exists() and not path.is_file():
            raise error(f"{path}: expected {what}, found {'a directory' if path.is_dir() else 'no file'}")
        with path.open("rb") as file:
            content = file.read(MAX_FILE_BYTES + 1)
    except FileNotFoundError:
        raise error(f"{path}: expected {what}, found none") from None
    except (OSError, ValueError) as problem:
        reason = getattr(problem, "strerror", None) or "invalid path"
        raise error(f"{str(path)[:80]}: expected {what}, could not read it: {reason}") from None
    if len(content) > MAX_FILE_BYTES:
        raise error(f"{path}: expected {what} of at most {MAX_FILE_BYTES // 1024} kB, found a larger file")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise error(f"{path}: expected {what}, could not read it: not UTF-8") from None
    try:
        return convert(parse_yaml(text))
    except yaml.YAMLError as problem:
        raise error(f"{path}: expected YAML, {in_one_line(problem)}") from None
    except TactileLocalizerError as problem:
        raise error(f"{path}: {problem}") from None


def parse_yaml(text: str) -> Any:
    """Parse a YAML text.

    Raises
    ------
    yaml.YAMLError
        The text is not YAML, or exceeds the limits above.
    """
    loader = _Loader(text)
    try:
        return loader.get_single_data()
    except (ValueError, RecursionError, OverflowError) as problem:  # a tag that does not match its value
        raise yaml.YAMLError(f"a value that matches its tag, {problem}") from None
    finally:
        loader.dispose()


def in_one_line(problem: yaml.YAMLError) -> str:
    """Message of a YAML error in one line, without PyYAML's excerpt of the file."""
    mark = getattr(problem, "problem_mark", None)
    if isinstance(problem, yaml.MarkedYAMLError) and mark is not None:
        return f"{problem.problem} (line {mark.line + 1})"
    return " ".join(str(problem).split())[:200]


def _require_bounded(root: yaml.Node) -> None:
    """Refuse documents with too many values after expansion of aliases, and recursive aliases."""
    sizes: dict[int, int] = {}
    open_nodes: set[int] = set()

    def size_of(node: yaml.Node) -> int:
        if node.tag not in _TAGS:
            raise _error_at(node, f"plain values, found the tag {node.tag.replace(_PREFIX, '!!')[:40]}")
        if isinstance(node, yaml.ScalarNode):
            return 1
        if id(node) in open_nodes:
            raise _error_at(node, "finite values, found an alias within its own anchor")
        if id(node) not in sizes:
            open_nodes.add(id(node))
            parts = (
                node.value if isinstance(node, yaml.SequenceNode) else [n for kv in node.value for n in kv]
            )
            sizes[id(node)] = 1 + sum(map(size_of, parts))
            open_nodes.remove(id(node))
        if sizes[id(node)] > _MAX_VALUES:
            raise _error_at(node, f"at most {_MAX_VALUES} values, found more")
        return sizes[id(node)]

    size_of(root)


def _description(node: yaml.Node) -> str:
    if isinstance(node, yaml.ScalarNode):
        return str(node.value)[:40]
    return "a list" if isinstance(node, yaml.SequenceNode) else "a mapping"


def _error_at(node: Any, text: str) -> yaml.YAMLError:
    mark = getattr(node, "start_mark", None)
    where = f" (line {mark.line + 1})" if mark else ""
    return yaml.YAMLError(f"{text}{where}")
