"""Digest of a scan and a scene, the key of results that were computed from them."""

import hashlib
import json
from dataclasses import asdict

import numpy as np

from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Scene


def digest_of(scan: Scan, scene: Scene) -> str:
    """Hexadecimal digest of ``scan`` and ``scene``, but for its name; the same on every machine."""
    digest = hashlib.blake2b(digest_size=16)
    meaning = asdict(scene) | {"name": ""}
    text = {"scene": meaning, "axes": scan.axes, "phalanges": scan.phalanges, "pairs": len(scan)}
    if scan.sessions:
        text["sessions"] = scan.sessions
    digest.update(json.dumps(text, sort_keys=True, default=np.ndarray.tolist).encode())
    for array, kind in ((scan.states, "<f8"), (scan.strain, "<f8"), (scan.sweep, "<i8")):
        digest.update(np.ascontiguousarray(array, dtype=kind).data)
    return digest.hexdigest()
