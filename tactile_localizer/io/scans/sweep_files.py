"""Files of one sweep: ``sweep_0001.npz`` when it is complete, ``sweep_0001.recording`` while it is recorded.

The npz has the arrays ``stamp_ns`` (n,), ``position`` (n, d) and ``strain`` (n, C), the numbers of samples
that were not used and why the sweep ended. Its last eight bytes, the comment of the zip archive, are the
CRC-32 of all bytes before, so that any changed byte is found. The recording is a sequence of records of one
size, each a pair and its CRC-32; what a killed process left of its last record is ignored.
"""

from __future__ import annotations

import io
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from tactile_localizer.errors import ScanError
from tactile_localizer.io.recording import ENDED_EARLY, RecordedSweep
from tactile_localizer.io.status import OK
from tactile_localizer.io.whole_file import whole_file
from tactile_localizer.scene import LARGEST_POSITION, LARGEST_STRAIN, Scene

_COUNTS_AND_TEXTS = {"gaps": int, "skipped": int, "ending": str, "strain_unit": str}
_STORED = ("stamp_ns", "position", "strain", "started_ns", "ended_ns", *_COUNTS_AND_TEXTS)
_SEAL_BYTES = 8
_END_OF_ARCHIVE = b"PK\x05\x06"
_END_BYTES = 22
"""Length of the last entry of a zip archive without comment."""


def sweep_number(file: Path) -> int:
    """Number of the sweep in a file."""
    return int(file.stem.partition("_")[2])


def write_sweep(path: Path, sweep: RecordedSweep, scene: Scene) -> None:
    """Write a complete sweep under a temporary name, sync it and rename it.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    archive = io.BytesIO()
    stored: dict[str, Any] = {name: getattr(sweep, name) for name in _STORED}
    np.savez(
        archive,
        **stored,
        axes=np.array(scene.axis_names),
        phalanges=np.array(scene.phalanx_names),
        channels=np.array(scene.layout.counts),
    )
    content = archive.getvalue()[:-2] + _SEAL_BYTES.to_bytes(2, "little")  # length of the archive's comment
    with whole_file(path) as unfinished:
        unfinished.write_bytes(content + _seal(content))


def read_sweep(path: Path, scene: Scene) -> RecordedSweep:
    """Read a complete sweep, also one that was written by ``numpy.savez`` without the last eight bytes.

    Raises
    ------
    OSError
        The file cannot be read.
    ScanError
        It is damaged, or belongs to another scene.
    """
    try:
        content = path.read_bytes()
        is_sealed = content[-_SEAL_BYTES:] == _seal(content[:-_SEAL_BYTES])
        if not is_sealed and not content[-_END_BYTES:].startswith(_END_OF_ARCHIVE):
            raise ValueError("its checksum does not match")
        with np.load(io.BytesIO(content)) as file:
            arrays = {name: file[name] for name in file.files}
        return _checked(sweep_number(path), arrays, scene)
    except OSError:
        raise
    except Exception as error:  # damaged archives raise errors of zipfile, zlib, struct, numpy and others
        raise ScanError(f"{path}: damaged, {type(error).__name__ if not str(error) else error}") from None


def record_type(scene: Scene) -> np.dtype:
    """Record of a sweep in progress: a pair and its CRC-32."""
    pair = [
        ("stamp_ns", "<i8"),
        ("position", "<f8", (scene.dimension,)),
        ("strain", "<f8", (scene.layout.size,)),
    ]
    return np.dtype([("pair", pair), ("crc", "<u4")])


def records(stamp_ns: np.ndarray, position: np.ndarray, strain: np.ndarray, scene: Scene) -> np.ndarray:
    """Pairs as records, (n,) of :func:`record_type`."""
    made = np.empty(len(stamp_ns), record_type(scene))
    made["pair"]["stamp_ns"], made["pair"]["position"], made["pair"]["strain"] = stamp_ns, position, strain
    made["crc"] = _checksums(made)
    return made


def read_recording(path: Path, scene: Scene) -> RecordedSweep:
    """Read what is in the file of a sweep in progress; damaged records are skipped.

    Raises
    ------
    OSError
        The file cannot be read.
    """
    kind, content = record_type(scene), path.read_bytes()
    found = np.frombuffer(content, kind, count=len(content) // kind.itemsize)
    intact = found["crc"] == _checksums(found)
    pairs = found["pair"][intact]
    return RecordedSweep(
        number=sweep_number(path),
        stamp_ns=pairs["stamp_ns"].copy(),
        position=pairs["position"].copy(),
        strain=pairs["strain"].copy(),
        status=_all_ok(len(pairs), scene),
        skipped=int(np.sum(~intact)),
        ending=ENDED_EARLY,
    )


def _require_plausible(position: np.ndarray, strain: np.ndarray) -> None:
    """Require that positions and strains are finite and of plausible magnitude.

    Raises
    ------
    ValueError
        A value is not finite, or beyond :data:`~tactile_localizer.scene.LARGEST_POSITION` or
        :data:`~tactile_localizer.scene.LARGEST_STRAIN`.
    """
    for what, values, largest in (
        ("position", position, LARGEST_POSITION),
        ("strain", strain, LARGEST_STRAIN),
    ):
        # Minimum and maximum are NaN if any value is, so no temporary array of the same size is needed.
        low, high = float(values.min(initial=0.0)), float(values.max(initial=0.0))
        if not (-largest <= low and high <= largest):
            worst = low if not -largest <= low else high
            raise ValueError(f"{what}: expected finite values of at most {largest:g}, found {worst:g}")


def _seal(content: bytes) -> bytes:
    return b"%08x" % zlib.crc32(content)


def _checksums(found: np.ndarray) -> list[int]:
    return [zlib.crc32(pair) for pair in np.ascontiguousarray(found["pair"])]


def _checked(number: int, arrays: dict[str, Any], scene: Scene) -> RecordedSweep:
    """A sweep of the arrays in its file, whose shapes and values must fit the scene."""
    for name, expected in (
        ("axes", scene.axis_names),
        ("phalanges", scene.phalanx_names),
        ("channels", scene.layout.counts),
    ):
        found = tuple(arrays[name].tolist())
        if found != expected:
            raise ValueError(f"expected {name} {', '.join(map(str, expected))}, found {found}")
    stamp_ns, position, strain = (arrays[name] for name in ("stamp_ns", "position", "strain"))
    n = stamp_ns.size
    kinds = (stamp_ns.dtype.kind, position.dtype.kind, strain.dtype.kind)
    shapes = (stamp_ns.shape, position.shape, strain.shape)
    expected_shapes = ((n,), (n, scene.dimension), (n, scene.layout.size))
    if kinds != ("i", "f", "f") or shapes != expected_shapes:
        raise ValueError(f"expected integers and floats of shapes {expected_shapes}, found {shapes}")
    _require_plausible(position, strain)
    return RecordedSweep(
        number,
        stamp_ns.astype(np.int64, copy=False),
        position.astype(np.float64, copy=False),
        strain.astype(np.float64, copy=False),
        _all_ok(n, scene),
        **{name: kind(arrays[name]) for name, kind in _COUNTS_AND_TEXTS.items()},
    )


def _all_ok(n: int, scene: Scene) -> np.ndarray:
    return np.full((n, len(scene.phalanges)), OK, dtype=np.uint8)
