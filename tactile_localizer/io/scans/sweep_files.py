"""File of one sweep, ``sweep_0001.npy``, which can be read at any moment of its recording.

It is an npy file of records, each a pair and its CRC-32, which continues that of the scene. Behind them the
end of the sweep adds a line of JSON with its own CRC-32: the numbers of samples that were not used, the unit
and the scene. Without this line, as a killed process leaves the file, the sweep ended early.
"""

from __future__ import annotations

import io
import json
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from tactile_localizer.errors import ScanError
from tactile_localizer.io.recording import ENDED, ENDED_EARLY, RecordedSweep
from tactile_localizer.io.scene_file import require_same_scene, scene_to_dict
from tactile_localizer.io.status import OK
from tactile_localizer.io.whole_file import open_file
from tactile_localizer.scene import Scene

_END = b"\nsweep "


def record_type(scene: Scene) -> np.dtype:
    """Record of a pair: stamp, ns, position, strain and CRC-32."""
    position, strain = ("position", "<f8", (scene.dimension,)), ("strain", "<f8", (scene.layout.size,))
    return np.dtype([("stamp_ns", "<i8"), position, strain, ("crc", "<u4")])


def header_of(scene: Scene, pairs: int) -> bytes:
    """Begin of the file, of the same length for any number of pairs."""
    kind = np.lib.format.dtype_to_descr(record_type(scene))
    begin = io.BytesIO()
    np.lib.format.write_array_header_1_0(begin, {"descr": kind, "fortran_order": False, "shape": (pairs,)})
    return begin.getvalue()


def records_of(stamp_ns: np.ndarray, position: np.ndarray, strain: np.ndarray, scene: Scene) -> bytes:
    """Records of pairs: stamps (n,), ns, positions (n, d) and strains (n, C)."""
    made = np.zeros(len(stamp_ns), record_type(scene))
    made["stamp_ns"], made["position"], made["strain"] = stamp_ns, position, strain
    start = _checksum(scene)
    made["crc"] = [zlib.crc32(record.tobytes()[:-4], start) for record in made]
    return made.tobytes()


def end_of(scene: Scene, **details: Any) -> bytes:
    """End of the file of a complete sweep: ``gaps``, ``skipped`` and ``strain_unit``."""
    text = json.dumps({**details, "scene": scene_to_dict(scene)}).encode()
    return _END + b"%08x %s\n" % (zlib.crc32(text), text)


def read_sweep(path: Path, number: int, scene: Scene) -> tuple[RecordedSweep, int]:
    """Read a sweep, complete or in progress, and the number of its damaged records.

    Raises
    ------
    ScanError
        The file cannot be read, belongs to another scene, or no record is intact.
    """
    try:
        with open_file(path) as file:
            content = file.read()[len(header_of(scene, 0)) :]
    except OSError as error:
        raise ScanError(f"{path}: could not be read, {error.strerror}") from None
    body, mark, end = content.rpartition(_END)
    details = _details(end) if mark else {}
    if details:
        require_same_scene(details.pop("scene"), scene_to_dict(scene), str(path))
    kind, start = record_type(scene), _checksum(scene)
    intact, at = [], 0
    records = memoryview(body if mark else content)
    while at + kind.itemsize <= len(records):
        record = records[at : at + kind.itemsize]
        is_intact = zlib.crc32(record[:-4], start) == int.from_bytes(record[-4:], "little")
        intact += [record] * is_intact
        at += kind.itemsize if is_intact else 1
    damaged = -((kind.itemsize * len(intact) - len(records)) // kind.itemsize)
    if damaged and not intact:
        raise ScanError(f"{path}: expected pairs of the scan's scene, found none that is intact")
    pairs = np.frombuffer(b"".join(intact), kind)
    sweep = RecordedSweep(
        number,
        pairs["stamp_ns"].copy(),
        pairs["position"].copy(),
        pairs["strain"].copy(),
        status=np.full((len(pairs), len(scene.phalanges)), OK, dtype=np.uint8),
        ending=ENDED if details else ENDED_EARLY,
        **details,
    )
    return sweep, damaged


def _checksum(scene: Scene) -> int:
    return zlib.crc32(json.dumps(scene_to_dict(scene)).encode())


def _details(end: bytes) -> dict[str, Any]:
    """What the last line says; empty if it is damaged."""
    crc, _, text = end.rstrip().partition(b" ")
    details: dict[str, Any] = json.loads(text) if crc == b"%08x" % zlib.crc32(text) else {}
    return details
