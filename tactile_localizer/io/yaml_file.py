"""Safe reading of YAML files with user input: mappings, lists, strings, numbers and booleans.

PyYAML follows YAML 1.1, in which ``3e-3`` is a string and the last of two equal keys wins. Here it is a
number, and keys are unique. Aliases, which could expand without limit, are refused.
"""

import re
import reprlib
from collections.abc import Callable, Hashable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import yaml

from tactile_localizer.errors import ParameterError, TactileLocalizerError, in_one_line
from tactile_localizer.io.whole_file import open_file

MAX_FILE_BYTES = 64 * 1024
"""Largest file that is read; a scene of five phalanges has about 1,500 bytes."""

_Converted = TypeVar("_Converted")


class _Loader(yaml.SafeLoader):
    """Loader for the subset of YAML described above."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            raise _error("no alias", self.peek_event())  # type: ignore[no-untyped-call]
        return super().compose_node(parent, index)

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Hashable, Any]:
        found = super().construct_mapping(node, deep=True)
        if len(found) < len(node.value):
            raise _error("each key once", node)
        return found


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+\Z"),
    list("-+.0123456789"),
)


def load_yaml(
    path: str | Path, what: str, error: type[TactileLocalizerError], convert: Callable[[Any], _Converted]
) -> _Converted:
    """Read a YAML file.

    Parameters
    ----------
    path : the file
    what : the expected kind of file for messages, such as ``a scene file``
    error : class of the exception to raise
    convert : makes the result of the content: mappings, lists, strings, numbers, booleans, ``None``

    Raises
    ------
    TactileLocalizerError
        As ``error``: the file is missing, cannot be read, is not YAML, is too large, or cannot be converted.
    """
    try:
        with open_file(path) as file:
            content = file.read(MAX_FILE_BYTES + 1)
        text = content.decode("utf-8-sig")
    except FileNotFoundError:
        raise error(f"{path}: expected {what}, found none") from None
    except (OSError, ValueError) as problem:
        reason = getattr(problem, "strerror", None) or "not UTF-8, or an invalid path"
        raise error(f"{str(path)[:255]}: expected {what}, could not read it: {reason}") from None
    if len(content) > MAX_FILE_BYTES:
        raise error(f"{path}: expected {what} of at most {MAX_FILE_BYTES // 1024} kB, found a larger file")
    try:
        return convert(parse_yaml(text))
    except yaml.YAMLError as problem:
        raise error(f"{path}: expected YAML, {yaml_reason(problem)}") from None
    except TactileLocalizerError as problem:
        raise error(f"{path}: {problem}") from None


def mapping(value: Any, what: str, known: Sequence[str] = ()) -> Mapping[Any, Any]:
    """``value``, which must be a mapping, with no other keys than ``known`` if there are any.

    Raises
    ------
    ParameterError
        It is something else, or has another key; the message calls it ``what``.
    """
    if not isinstance(value, Mapping):
        raise ParameterError(f"{what}: expected a mapping, got {reprlib.repr(value)}")
    for key in value:
        if known and key not in known:
            raise ParameterError(f"{what}: expected one of {', '.join(known)}, got {reprlib.repr(key)}")
    return value


def parse_yaml(text: str) -> Any:
    """Parse a YAML text.

    Raises
    ------
    yaml.YAMLError
        The text is not YAML of the subset described above.
    """
    try:
        return yaml.load(text, _Loader)  # noqa: S506  a SafeLoader
    except RecursionError:
        raise yaml.YAMLError("found too many lists in lists") from None
    except (ValueError, OverflowError, TypeError, AttributeError) as problem:
        # A tag that does not match its value.
        raise yaml.YAMLError(f"found {problem}") from None


def yaml_reason(problem: yaml.YAMLError) -> str:
    """Message of a YAML error in one line, without PyYAML's excerpt of the file."""
    mark = getattr(problem, "problem_mark", None)
    if isinstance(problem, yaml.MarkedYAMLError) and mark is not None:
        return f"{problem.problem} (line {mark.line + 1})"
    return in_one_line(problem)


def _error(expected: str, found: Any) -> yaml.YAMLError:
    return yaml.YAMLError(f"expected {expected} (line {found.start_mark.line + 1})")
