"""YAML files from people, read within bounds: plain mappings, lists, text, numbers and truth values.

PyYAML follows YAML 1.1, in which ``3e-3`` is text, ``010`` is eight, ``1:30`` is ninety, and the last of two
equal keys wins. Here numbers are decimal, keys are text and given once. Files that are large, deep, or that
unfold by aliases are refused before they cost time or memory.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Hashable
from pathlib import Path
from typing import Any

import yaml

from tactile_localizer.errors import TactileLocalizerError

LARGEST_BYTES = 64 * 1024
"""Most bytes of a file; a scene of five phalanges has about 1,500."""

_DEEPEST = 16
_MOST_NODES = 20_000
"""Most values, each alias counted as what it stands for."""

_PREFIX = "tag:yaml.org,2002:"
_TAGS = {_PREFIX + kind for kind in ("null", "bool", "int", "float", "str", "seq", "map")}


class _Loader(yaml.SafeLoader):
    """Reads the YAML that is described above."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._depth = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        self._depth += 1
        if self._depth > _DEEPEST:
            raise yaml.YAMLError(f"at most {_DEEPEST} levels, found more")
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
                raise _refusal(key, f"text as a key, found {_text_of(key)}{hint}")
        for name, count in Counter(key.value for key in keys).items():
            if count > 1:
                raise _refusal(node, f"the key {name[:40]!r} once, found it {count} times")
        return super().construct_mapping(node, deep=True)


_Loader.yaml_implicit_resolvers = {}  # PyYAML's own are replaced by these
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


def load_yaml(path: str | Path, what: str, error: type[TactileLocalizerError]) -> Any:
    """The content of a YAML file.

    Parameters
    ----------
    path : the file
    what : is expected, for messages, such as ``a scene file``
    error : is raised

    Returns
    -------
    Any
        Mappings with text as keys, lists, text, numbers, truth values, ``None``.

    Raises
    ------
    FileNotFoundError
        There is no such file; only the caller knows which there could be.
    TactileLocalizerError
        As ``error``: the file cannot be read, is not YAML, or goes beyond the bounds above.
    """
    path = Path(path)
    try:
        if path.exists() and not path.is_file():
            raise error(f"{path}: expected {what}, found {'a directory' if path.is_dir() else 'no file'}")
        with path.open("rb") as file:
            content = file.read(LARGEST_BYTES + 1)
    except FileNotFoundError:
        raise
    except (OSError, ValueError) as problem:
        reason = getattr(problem, "strerror", None) or "no path"
        raise error(f"{str(path)[:80]}: expected {what}, could not read it: {reason}") from None
    if len(content) > LARGEST_BYTES:
        raise error(f"{path}: expected {what} of at most {LARGEST_BYTES // 1024} kB, found a larger file")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise error(f"{path}: expected {what}, could not read it: not text in UTF-8") from None
    try:
        return parse_yaml(text)
    except yaml.YAMLError as problem:
        raise error(f"{path}: expected YAML, {in_one_line(problem)}") from None


def parse_yaml(text: str) -> Any:
    """The content of YAML text.

    Raises
    ------
    yaml.YAMLError
        It is not YAML, or goes beyond the bounds above.
    """
    loader = _Loader(text)
    try:
        return loader.get_single_data()
    except (ValueError, RecursionError, OverflowError) as problem:  # of a tag that its text does not fit
        raise yaml.YAMLError(f"a value that fits its tag, {problem}") from None
    finally:
        loader.dispose()


def in_one_line(problem: yaml.YAMLError) -> str:
    """What PyYAML found, without its excerpt of the file."""
    mark = getattr(problem, "problem_mark", None)
    if isinstance(problem, yaml.MarkedYAMLError) and mark is not None:
        return f"{problem.problem} (line {mark.line + 1})"
    return " ".join(str(problem).split())[:200]


def _require_bounded(root: yaml.Node) -> None:
    """Count the values that aliases unfold to, and find an alias within what it stands for."""
    sizes: dict[int, int] = {}
    open_nodes: set[int] = set()

    def size_of(node: yaml.Node) -> int:
        if node.tag not in _TAGS:
            raise _refusal(node, f"plain values, found the tag {node.tag.replace(_PREFIX, '!!')[:40]}")
        if isinstance(node, yaml.ScalarNode):
            return 1
        if id(node) in open_nodes:
            raise _refusal(node, "values that end, found an alias within what it stands for")
        if id(node) not in sizes:
            open_nodes.add(id(node))
            parts = (
                node.value if isinstance(node, yaml.SequenceNode) else [n for kv in node.value for n in kv]
            )
            sizes[id(node)] = 1 + sum(map(size_of, parts))
            open_nodes.remove(id(node))
        if sizes[id(node)] > _MOST_NODES:
            raise _refusal(node, f"at most {_MOST_NODES} values, found more")
        return sizes[id(node)]

    size_of(root)


def _text_of(node: yaml.Node) -> str:
    if isinstance(node, yaml.ScalarNode):
        return str(node.value)[:40]
    return "a list" if isinstance(node, yaml.SequenceNode) else "a mapping"


def _refusal(place: Any, text: str) -> yaml.YAMLError:
    mark = getattr(place, "start_mark", None)
    where = f" (line {mark.line + 1})" if mark else ""
    return yaml.YAMLError(f"{text}{where}")
