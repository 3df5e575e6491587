"""File of one sweep, ``sweep_0001.npy``, which can be read at any moment of its recording.

It is an npy file of records, each a pair and its CRC-32, which continues that of the scene. Behind them the
end of the sweep adds a line of JSON with its own CRC-32: the numbers of samples that were not used, the unit
and the scene. Without this line, as a killed process leaves the file, the sweep ended early.
"""

import io
import json
import math
import os
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tactile_localizer.errors import ScanError, refusing
from tactile_localizer.io.recording import ENDED, ENDED_EARLY, RecordedSweep
from tactile_localizer.io.scene_file import require_same_scene, scene_to_dict
from tactile_localizer.io.status import OK
from tactile_localizer.io.whole_file import open_file, writing
from tactile_localizer.scene import Scene

_END = b"\nsweep "
_RESIDUE = 0x2144DF1C
"""CRC-32 of anything that ends with its own CRC-32."""
_PIECE, _MOST_BYTES, _MOST_DAMAGE = 2**20, 2**28, 2**27
"""Bytes that are read at a time, and of pairs, half an hour at 1 kHz; checked bytes without an intact record
that end the reading."""


class OpenSweep:
    """A sweep in progress.

    Parameters
    ----------
    path : its file, which must not exist
    number : its number
    scene : of the scan
    after_ns : stamp before the first sample, ns

    Attributes
    ----------
    label : run and sweep of its samples in the session; see :class:`~.session.Pair`
    until : run and stamp, ns, of its last sample; ``None``: not known yet
    pairs : pairs so far
    gaps : strain samples without a pose close enough in time
    skipped : strain samples that were missing, saturated or out of bounds
    strain_unit : for display

    Raises
    ------
    ScanError
        The file exists or cannot be written.
    """

    def __init__(self, path: Path, number: int, scene: Scene, after_ns: int = -1) -> None:
        self.path, self.number, self.after_ns = path, number, after_ns
        self.label = 0, number
        self.until: tuple[int, int] | None = None
        self.pairs = self.gaps = self.skipped = 0
        self.strain_unit = "V"
        self._scene, self._records, self._size = scene, bytearray(), 0.0
        with writing(path):
            self._file = path.open("xb", buffering=0)
            self._identity = os.fstat(self._file.fileno())
        self._write(_header(scene, 0), sync=False)

    def append(self, stamp_ns: np.ndarray, position: np.ndarray, strain: np.ndarray) -> None:
        """Append pairs; they are on disk when the method returns and the sweep :attr:`is_in_place`.

        Parameters
        ----------
        stamp_ns : (n,) int64 stamps, ns
        position : (n, d) palm positions, m (yaw: rad), finite
        strain : (n, C) strain voltages, V, finite

        Raises
        ------
        ScanError
            The file cannot be written.
        """
        made = np.zeros(len(stamp_ns), _record_type(self._scene))
        made["stamp_ns"], made["position"], made["strain"] = stamp_ns, position, strain
        start = _checksum(self._scene)
        made["crc"] = [zlib.crc32(record.tobytes()[:-4], start) for record in made]
        self._records += made.tobytes()
        self.pairs += len(made)
        self._write(made.tobytes())

    def end(self) -> None:
        """Complete the sweep.

        Raises
        ------
        ScanError
            The file cannot be written. The sweep has ended early.
        """
        details = {"gaps": self.gaps, "skipped": self.skipped, "strain_unit": self.strain_unit}
        text = json.dumps({**details, "scene": scene_to_dict(self._scene)}).encode()
        with self._file:
            self._write(_END + b"%08x %s\n" % (zlib.crc32(text), text), sync=False)
            self._file.seek(0)
            self._write(_header(self._scene, self.pairs))

    @property
    def is_in_place(self) -> bool:
        """Whether the file at its path is the one that was made, with all that was written.

        Nothing is written to one that was removed, replaced or cut short.
        """
        try:
            found = self.path.stat()
        except OSError:
            return False
        return os.path.samestat(found, self._identity) and found.st_size >= self._size

    def recorded(self) -> RecordedSweep:
        """The sweep as it would be read, from memory."""
        details = {"gaps": self.gaps, "skipped": self.skipped, "strain_unit": self.strain_unit}
        pairs = np.frombuffer(self._records, _record_type(self._scene))
        return _recorded(self.number, pairs, self._scene, details)

    def _write(self, content: bytes, *, sync: bool = True) -> None:
        if not self.is_in_place:
            self._size = math.inf
            return
        with writing(self._file.name):
            while content:
                content = content[self._file.write(content) :]
            if sync:
                os.fdatasync(self._file.fileno())
        self._size = max(self._size, self._file.tell())


def read_sweep(path: Path, number: int, scene: Scene) -> tuple[RecordedSweep, int]:
    """Read a sweep, complete or in progress, and the number of its damaged records.

    Raises
    ------
    ScanError
        The file cannot be read, belongs to another scene, or no record is intact.
    """
    start, size, begin = _checksum(scene), _record_type(scene).itemsize, len(_header(scene, 0))
    intact, rest, at = bytearray(), b"", 0  # bytes behind the last intact record, and how many are checked
    most = max(2 * size, _MOST_DAMAGE // size)
    with refusing(f"{path}: could not be read", ScanError, OSError), open_file(path) as file:
        lost = os.fstat(file.fileno()).st_size - begin
        file.seek(begin)
        while at < most and len(intact) < _MOST_BYTES and (piece := file.read(_PIECE)):
            rest += piece
            good = 0
            while at + size <= len(rest) and at - good < most:
                record = rest[at : at + size]
                at += 1
                if zlib.crc32(record, start) == _RESIDUE:
                    intact += record
                    at = good = at - 1 + size
            rest, at = rest[good:], at - good
    _, mark, end = rest.rpartition(_END)
    line = end.partition(b"\n")[0]
    details = _details(line) if mark else {}
    if details:
        require_same_scene(details.pop("scene"), scene_to_dict(scene), str(path))
    lost -= len(intact) + (len(mark + line) + 1 if mark else 0)
    damaged = max(-(-lost // size), 0)
    if damaged and not intact:
        raise ScanError(f"{path}: expected pairs of the scan's scene, found none that is intact")
    ending = ENDED if details else ENDED_EARLY
    pairs = np.frombuffer(intact, _record_type(scene))
    rising = np.ones(len(pairs), dtype=bool)  # unlike those of a part that is in the file twice
    rising[1:] = pairs["stamp_ns"][1:] > np.maximum.accumulate(pairs["stamp_ns"])[:-1]
    sweep = _recorded(number, pairs[rising], scene, {"ending": ending, **details})
    return sweep, damaged + int(np.sum(~rising))


def _recorded(number: int, pairs: np.ndarray, scene: Scene, details: Mapping[str, Any]) -> RecordedSweep:
    return RecordedSweep(
        number,
        pairs["stamp_ns"].copy(),
        pairs["position"].copy(),
        pairs["strain"].copy(),
        status=np.full((len(pairs), len(scene.phalanges)), OK, dtype=np.uint8),
        **details,
    )


def _record_type(scene: Scene) -> np.dtype:
    position, strain = ("position", "<f8", (scene.dimension,)), ("strain", "<f8", (scene.layout.size,))
    return np.dtype([("stamp_ns", "<i8"), position, strain, ("crc", "<u4")])


def _header(scene: Scene, pairs: int) -> bytes:
    """Begin of the file, of the same length for any number of pairs."""
    kind = np.lib.format.dtype_to_descr(_record_type(scene))
    begin = io.BytesIO()
    np.lib.format.write_array_header_1_0(begin, {"descr": kind, "fortran_order": False, "shape": (pairs,)})
    return begin.getvalue()


def _checksum(scene: Scene) -> int:
    return zlib.crc32(json.dumps(scene_to_dict(scene)).encode())


def _details(end: bytes) -> dict[str, Any]:
    """What the last line says; empty if it is damaged."""
    crc, _, text = end.partition(b" ")
    return json.loads(text) if crc == b"%08x" % zlib.crc32(text) else {}
