"""Strain and pose messages straight from their bytes (CDR), many at once: only what recordings need of them.

A bag of ten minutes holds a quarter of a million. Those of one topic differ in their numbers alone, so the
first shows where the numbers are, and those whose other bytes are the same are read as one array. Only
little-endian messages of the definitions that come with this package are decoded here.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.geometry.palm_frame import PalmFrame
from tactile_localizer.errors import MeasurementError
from tactile_localizer.scene import Scene

_LITTLE_ENDIAN = b"\x00\x01"
_BODY = 4
"""Bytes before the body, from whose start alignment counts."""

_COUNT = struct.Struct("<I")
_NOT_FINITE = "palm pose: expected finite numbers"
_NANOSECONDS = 1_000_000_000


class Strains(NamedTuple):
    """What n ``StrainVectors`` messages tell of a scene's phalanges, in their order.

    ``stamp_ns`` (n,), ``values`` (n, C) V, ``status`` (n, F), and whether each ``fits`` (n,): one that does
    not has lengths that contradict each other.
    """

    stamp_ns: np.ndarray
    values: np.ndarray
    status: np.ndarray
    fits: np.ndarray


class Poses(NamedTuple):
    """What n ``PoseStamped`` messages tell of the palm, in their order.

    ``stamp_ns`` (n,), ``position`` (n, d) m (yaw: rad), whether each ``fits`` (n,), and why the first that
    does not is ``refused``.
    """

    stamp_ns: np.ndarray
    position: np.ndarray
    fits: np.ndarray
    refused: str


class StrainDecoder:
    """Makes :class:`Strains` of messages.

    Parameters
    ----------
    scene : names the phalanges

    Raises
    ------
    SceneError
        While decoding: a message lacks one of the phalanges.
    """

    kind = "tactile_localizer/msg/StrainVectors"

    def __init__(self, scene: Scene) -> None:
        self._scene = scene

    def of_message(self, message: Any) -> Strains:
        """From one message object."""
        numbers = np.array([stamp_of(message)]), message.strain[None], message.status[None]
        counts = tuple(map(int, getattr(message, "channels", ())))
        return self._strains(1, [(tuple(message.phalanges), counts, np.zeros(1, int), *numbers)])

    def of_bytes(self, raws: Sequence[bytes]) -> Strains:
        """From the bytes of messages."""
        alike = (
            (form.texts[1:], form.counts, rows, _stamps(numbers), numbers["strain"], numbers["status"])
            for form, rows, numbers in _alike(raws, _strain_form)
        )
        return self._strains(len(raws), alike)

    def _strains(
        self,
        n: int,
        alike: Iterable[
            tuple[tuple[str, ...], tuple[int, ...], np.ndarray, np.ndarray, np.ndarray, np.ndarray]
        ],
    ) -> Strains:
        layout = self._scene.layout
        found = Strains(
            np.zeros(n, np.int64),
            np.zeros((n, layout.size)),
            np.zeros((n, layout.phalanges), np.uint8),
            np.zeros(n, bool),
        )
        for names, counts, rows, stamp_ns, values, status in alike:
            if len(counts) not in (0, len(names)):
                continue
            felt, channels = self._scene.rows(names), self._scene.channels(names, counts)
            size = ChannelLayout.of(counts, len(names)).size
            if values.shape[1] == size and status.shape[1] == len(names):
                found.stamp_ns[rows] = stamp_ns
                found.values[rows] = values[:, channels]
                found.status[rows] = status[:, felt]
                found.fits[rows] = True
        return found


class PoseDecoder:
    """Makes :class:`Poses` of messages.

    Parameters
    ----------
    frame : brings poses onto the scene's axes
    """

    kind = "geometry_msgs/msg/PoseStamped"

    def __init__(self, frame: PalmFrame) -> None:
        self._frame = frame

    def of_message(self, message: Any) -> Poses:
        """From one message object."""
        place, turn = message.pose.position, message.pose.orientation
        numbers = np.array([[place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w]])
        stamp_ns = np.array([stamp_of(message)])
        return self._poses(1, [(message.header.frame_id, np.zeros(1, int), stamp_ns, numbers)])

    def of_bytes(self, raws: Sequence[bytes]) -> Poses:
        """From the bytes of messages."""
        alike = (
            (form.texts[0], rows, _stamps(numbers), numbers["pose"])
            for form, rows, numbers in _alike(raws, _pose_form)
        )
        return self._poses(len(raws), alike)

    def _poses(self, n: int, alike: Iterable[tuple[str, np.ndarray, np.ndarray, np.ndarray]]) -> Poses:
        stamps = np.zeros(n, np.int64)
        position = np.full((n, self._frame.dimension), np.nan)
        refused = ""
        for name, rows, stamp_ns, numbers in alike:
            stamps[rows] = stamp_ns
            try:
                position[rows] = self._frame.positions(name, numbers[:, :3], numbers[:, 3:])
            except MeasurementError as error:
                refused = refused or str(error)
        fits = np.isfinite(position).all(axis=1)
        return Poses(stamps, position, fits, refused or ("" if fits.all() else _NOT_FINITE))


def stamp_of(message: Any) -> int:
    """The header's stamp of a message object, ns."""
    stamp = message.header.stamp
    return int(stamp.sec) * _NANOSECONDS + int(stamp.nanosec)


class _Form(NamedTuple):
    """Where a message's numbers are, its texts and channel counts, and the bytes that tell this form."""

    numbers: np.dtype[Any]
    texts: tuple[str, ...]
    counts: tuple[int, ...]
    telling: np.ndarray


class _Walk:
    """Walks one message and notes its form."""

    def __init__(self, raw: bytes) -> None:
        if raw[:2] != _LITTLE_ENDIAN:
            raise ValueError(f"CDR: expected little-endian bytes, got {raw[:2]!r}")
        self._raw, self._at = raw, _BODY
        self._telling = [np.arange(2)]
        self._texts: list[str] = []
        self._counts: tuple[int, ...] = ()
        self._fields: dict[str, tuple[Any, int]] = {}

    def header(self) -> None:
        """A ``std_msgs/Header``."""
        self.numbers("sec", "<i4")
        self.numbers("nanosec", "<u4")
        self.text()

    def numbers(self, name: str, kind: str, count: int | None = None) -> None:
        """One number, or an array of ``count``; an empty one is not aligned."""
        size = np.dtype(kind).itemsize
        if count != 0:
            self._align(size)
        self._fields[name] = ((kind, (count,)) if count is not None else kind), self._at
        self._at += size * (1 if count is None else count)

    def text(self) -> None:
        """A string, which ends with a zero byte."""
        size = self.count()
        self._texts.append(str(self._raw[self._at : self._at + max(size - 1, 0)], "utf-8"))
        self._tell(size)

    def count(self) -> int:
        """The length of what follows."""
        self._align(4)
        (found,) = _COUNT.unpack_from(self._raw, self._at)
        self._tell(_COUNT.size)
        if found > len(self._raw):
            raise ValueError(f"CDR: expected at most {len(self._raw)} elements, got {found}")
        return int(found)

    def counts(self) -> None:
        """An array of ``uint16``, which belongs to the form; messages of earlier versions end before it."""
        if self._at < len(self._raw):
            size = 2 * self.count()
            self._counts = struct.unpack_from(f"<{size // 2}H", self._raw, self._at)
            self._tell(size)

    def form(self) -> _Form:
        """What was noted; raises ValueError where the message ends before its last number does."""
        names, (formats, offsets) = list(self._fields), zip(*self._fields.values(), strict=True)
        parts: Any = {"names": names, "formats": formats, "offsets": offsets, "itemsize": len(self._raw)}
        return _Form(np.dtype(parts), tuple(self._texts), self._counts, np.concatenate(self._telling))

    def _tell(self, size: int) -> None:
        self._telling.append(np.arange(self._at, self._at + size))
        self._at += size

    def _align(self, size: int) -> None:
        self._at += -(self._at - _BODY) % size


def _strain_form(raw: bytes) -> _Form:
    walk = _Walk(raw)
    walk.header()
    for _ in range(walk.count()):
        walk.text()
    walk.numbers("strain", "<f8", walk.count())
    walk.numbers("status", "u1", walk.count())
    walk.numbers("sequence", "<u4", walk.count())
    walk.counts()
    return walk.form()


def _pose_form(raw: bytes) -> _Form:
    walk = _Walk(raw)
    walk.header()
    walk.numbers("pose", "<f8", 7)
    return walk.form()


def _alike(
    raws: Sequence[bytes], form_of: Callable[[bytes], _Form]
) -> Iterator[tuple[_Form, np.ndarray, np.ndarray]]:
    """Messages of one form together: the form, their rows (k,) and their numbers, a structured array (k,).

    Those that have no form, because they end too early, are left out.
    """
    lengths = np.array([len(raw) for raw in raws])
    for length in np.unique(lengths[lengths > _BODY]):
        rows = np.flatnonzero(lengths == length)
        octets = np.frombuffer(b"".join(raws[row] for row in rows.tolist()), np.uint8).reshape(-1, length)
        while len(rows):
            try:
                form = form_of(octets[0].tobytes())
            except (ValueError, struct.error):
                rows, octets = rows[1:], octets[1:]
                continue
            same = (octets[:, form.telling] == octets[0, form.telling]).all(axis=1)
            yield form, rows[same], octets[same].view(form.numbers)[:, 0]
            rows, octets = rows[~same], octets[~same]


def _stamps(numbers: np.ndarray) -> np.ndarray:
    return numbers["sec"].astype(np.int64) * _NANOSECONDS + numbers["nanosec"]
