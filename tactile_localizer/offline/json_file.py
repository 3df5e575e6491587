"""JSON files of results, with arrays as lists and numbers that are not finite as null."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tactile_localizer.errors import ScanError
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


def plain_columns(columns: Mapping[str, np.ndarray | list[Any]]) -> Iterator[dict[str, Any]]:
    """Rows of columns of equal length, converted as by :func:`plain` but faster."""
    lists = [column if isinstance(column, list) else _entries(column) for column in columns.values()]
    return (dict(zip(columns, row, strict=True)) for row in zip(*lists, strict=True))


def _entries(column: np.ndarray) -> list[Any]:
    finite = np.isfinite(column)
    return (column if finite.all() else np.where(finite, column.astype(object), np.array(None))).tolist()


def _line(row: Any) -> str:
    try:
        return _ENCODER.encode(row)
    except ValueError:
        return json.dumps(plain(row))


_ENCODER = json.JSONEncoder(allow_nan=False, default=plain)


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
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as unfinished, unfinished.open("w", encoding="utf-8") as file:
            if rows is None:
                file.write(text + "\n")
                return
            file.write(f'{text[:-2]},\n "{rows}": [\n')
            for number, row in enumerate(value[rows]):
                file.write((",\n" if number else "") + _line(row))
            file.write("\n]\n}\n")
    except OSError as error:
        raise ScanError(f"{path}: expected to write results, {error.strerror}") from None
