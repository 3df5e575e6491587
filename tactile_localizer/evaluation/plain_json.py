"""Results as JSON: numpy's arrays and numbers as plain ones, what is not finite as null."""

from __future__ import annotations

import dataclasses
import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tactile_localizer.errors import ScanError


def plain(value: Any) -> Any:
    """``value`` of mappings, sequences, dataclasses, arrays and numbers as JSON can hold it."""
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
    value : may hold what :func:`plain` knows
    rows : name of an entry that is a list, to be written with one element a line

    Raises
    ------
    ScanError
        The file cannot be written.
    """
    path = Path(path)
    unfinished = path.with_name(f"{path.name}.part{os.getpid()}")
    text = json.dumps(plain({name: entry for name, entry in value.items() if name != rows}), indent=1)
    if rows is not None:
        lines = ",\n".join(json.dumps(plain(row)) for row in value[rows])
        text = f'{text[:-2]},\n "{rows}": [\n{lines}\n]\n}}'
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        unfinished.write_text(text + "\n", encoding="utf-8")
        unfinished.replace(path)
    except OSError as error:
        raise ScanError(f"{path}: expected to write results, {error.strerror}") from None
