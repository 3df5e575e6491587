"""Digest of a scan and a scene, the key of results that were computed from them."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Scene


def digest_of(scan: Scan, scene: Scene) -> str:
    """Hexadecimal digest of the contents of ``scan`` and ``scene``.

    Equal values give equal digests on every machine and in every process, whatever the memory layout of
    the arrays and whether a number is an ``int``, a ``float`` or a numpy scalar.
    """
    digest = hashlib.blake2b(digest_size=16)
    text = {"scene": _plain(scene), "axes": scan.axes, "phalanges": scan.phalanges, "pairs": len(scan)}
    digest.update(json.dumps(text, sort_keys=True).encode())
    for array, kind in ((scan.states, "<f8"), (scan.strain, "<f8"), (scan.sweep, "<i8")):
        digest.update(np.ascontiguousarray(array, dtype=kind).data)
    return digest.hexdigest()


def _plain(value: Any) -> Any:
    """``value`` as mappings, lists and strings, which have only one JSON representation."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: _plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value).hex()
    return value if value is None or isinstance(value, bool) else str(value)
