"""Objects of the package in one file of arrays: what a filter needs of a scan, kept for the next start.

An object is written as its class and its attributes, so a change of the model needs no change here. What is
read was made by the same code from the same content, or it is not read: the key of a file has a digest of
both. The members of the file, a zip, have checksums.
"""

from __future__ import annotations

import enum
import hashlib
import importlib
import json
import zipfile
import zlib
from collections.abc import Callable, Iterable, Sequence
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np

import tactile_localizer
from tactile_localizer.errors import ScanError
from tactile_localizer.io.whole_file import open_file, whole_file

_PACKAGE = tactile_localizer.__name__
_CODE = ("core/**/*.py", "io/scans/*.py", "*.py")
"""What the objects are made by: files of the package."""
_TEXT = "objects"
"""Name of the array with the text that describes the objects."""
_FAULTS = (OSError, EOFError, ValueError, LookupError, TypeError, AttributeError, ImportError, RecursionError)


def key_of(parts: Iterable[bytes]) -> str:
    """Key of what is made from some content by this code, hexadecimal."""
    digest = hashlib.blake2b(_code(), digest_size=16)
    for part in parts:
        digest.update(len(part).to_bytes(8, "little"))
        digest.update(part)
    return digest.hexdigest()


@cache
def _code() -> bytes:
    """Digest of the code, and of the version of numpy, whose sums may differ in the last digit."""
    root = Path(tactile_localizer.__file__).parent
    digest = hashlib.blake2b(f"{tactile_localizer.__version__} {np.__version__}".encode(), digest_size=32)
    for file in sorted({file for pattern in _CODE for file in root.glob(pattern)}):
        digest.update(file.read_bytes())
    return digest.digest()


def store(path: Path, keys: Sequence[str], value: Any) -> None:
    """Write an object that is found by each of the ``keys``; a failure costs only the time to make it again.

    Raises
    ------
    ScanError
        The file cannot be written.
    TypeError
        The object has a part that is neither an array, a value nor an object of the package.
    """
    arrays: dict[int, np.ndarray] = {}
    text = json.dumps({"keys": list(keys), "value": _packed(value, arrays)})
    members = {_TEXT: np.frombuffer(text.encode(), np.uint8)}
    members |= {f"array_{number}": array for number, array in enumerate(arrays.values())}
    with whole_file(path, ScanError) as unfinished, unfinished.open("wb") as file:
        np.savez(file, **members)  # type: ignore[arg-type]


def load(path: Path, key: str) -> Any:
    """The object of a file; ``None`` if there is none of this ``key``, or it is damaged."""
    try:
        with open_file(path) as file, np.load(file, allow_pickle=False) as members:
            content = json.loads(members[_TEXT].tobytes())
            if key not in content["keys"]:
                return None
            return _unpacked(content["value"], cache(lambda number: members[f"array_{number}"]))
    except (*_FAULTS, zipfile.BadZipFile, zlib.error):
        return None


def _packed(value: Any, arrays: dict[int, np.ndarray]) -> Any:
    """A value as JSON, with the places of its arrays, each of which is added to ``arrays`` once."""
    if type(value) in (type(None), bool, int, float, str):
        return value
    if isinstance(value, np.ndarray):
        if value.dtype.hasobject:
            raise TypeError("an array of objects")
        arrays.setdefault(id(value), value)
        return {"array": list(arrays).index(id(value))}
    if isinstance(value, np.generic):
        return {"scalar": value.dtype.str, "value": value.item()}
    if type(value) in (tuple, list):
        return {type(value).__name__: [_packed(each, arrays) for each in value]}
    if type(value) is dict:
        return {"dict": [[_packed(each, arrays) for each in item] for item in value.items()]}
    kind = type(value)
    if not kind.__module__.startswith(f"{_PACKAGE}."):
        raise TypeError(f"expected an object of {_PACKAGE}, found {kind.__module__}.{kind.__qualname__}")
    name = {"class": f"{kind.__module__}:{kind.__qualname__}"}
    if isinstance(value, enum.Enum):
        return name | {"member": value.name}
    if isinstance(value, tuple):
        return name | {"fields": [_packed(each, arrays) for each in value]}
    state = {
        attribute: _packed(each, arrays)
        for attribute, each in vars(value).items()
        if not isinstance(getattr(kind, attribute, None), cached_property)
    }
    return name | {"state": state}


def _unpacked(content: Any, array: Callable[[int], np.ndarray]) -> Any:
    if not isinstance(content, dict):
        return content
    if "array" in content:
        return array(content["array"])
    if "scalar" in content:
        return np.dtype(content["scalar"]).type(content["value"])
    for kind in (tuple, list):
        if kind.__name__ in content:
            return kind(_unpacked(each, array) for each in content[kind.__name__])
    if "dict" in content:
        return dict([_unpacked(each, array) for each in item] for item in content["dict"])
    module, _, name = content["class"].partition(":")
    made = getattr(importlib.import_module(module), name) if module.startswith(f"{_PACKAGE}.") else None
    if not isinstance(made, type) or made.__module__ != module:
        raise ValueError(f"expected a class of {_PACKAGE}, found {content['class']}")
    if "member" in content:
        return made[content["member"]]  # type: ignore[index]
    if "fields" in content:
        return made.__new__(made, *(_unpacked(each, array) for each in content["fields"]))
    value: Any = object.__new__(made)
    vars(value).update({key: _unpacked(each, array) for key, each in content["state"].items()})
    return value
