"""JSON files of results, with arrays as lists and numbers that are not finite as null."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tactile_localizer.io.whole_file import whole_file


def plain(value: Any) -> Any:
    """Convert mappings, sequences, dataclasses, arrays and numbers to values that JSON can hold."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = dataclasses.asdict(value)
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    return value


def write_json(path: str | Path, value: Mapping[str, Any], rows: str | None = None) -> None:
    """Write ``value`` to a file that appears only when it is complete.

    Parameters
    ----------
    path : file to write; missing folders are created
    value : mapping of values that :func:`plain` converts
    rows : name of an iterable in ``value`` that is written row by row, one per line

    Raises
    ------
    ScanError
        The file cannot be written.
    """
    text = json.dumps(plain({name: entry for name, entry in value.items() if name != rows}), indent=1)
    with whole_file(path) as unfinished, unfinished.open("w", encoding="utf-8") as file:
        if rows is None:
            file.write(text + "\n")
            return
        file.write(f'{text[:-2]},\n "{rows}": [\n')
        for number, row in enumerate(value[rows]):
            file.write((",\n" if number else "") + json.dumps(plain(row)))
        file.write("\n]\n}\n")
