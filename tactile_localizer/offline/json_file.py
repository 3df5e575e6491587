"""JSON files of results, with arrays as lists and numbers that are not finite as null."""

import dataclasses
import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tactile_localizer import __version__
from tactile_localizer.io.whole_file import RESULT, write_text


def plain(value: Any) -> Any:
    """Convert mappings, sequences, iterators, dataclasses, arrays and numbers to what JSON can hold."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = dataclasses.asdict(value)
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple | Iterator):
        return [plain(entry) for entry in value]
    return value


def json_text(value: Mapping[str, Any]) -> str:
    """``value``, which :func:`plain` converts, as a line of JSON that begins with its kind and version."""
    return json.dumps({"kind": RESULT, "version": __version__, **plain(value)}) + "\n"


def write_json(path: str | Path, value: Mapping[str, Any]) -> None:
    """Write ``value``, which :func:`plain` converts, to a file that appears only when it is complete.

    Missing folders are created.

    Raises
    ------
    ScanError
        The file cannot be written.
    """
    write_text(path, json_text(value))
