"""Conversion of messages of any type to strain vectors, with a mapping of fields to channels in YAML.

One entry per phalanx; each message of the first phalanx gives one strain vector::

    phalanges:
      index:
        topic: /wrench
        type: geometry_msgs/msg/WrenchStamped
      middle:
        topic: /taxels
        type: std_msgs/msg/Float32MultiArray
        fields: [data[0:16]]       # or one path per channel: [wrench.force.x, wrench.force.y]
        scale: 0.001               # factor to the unit of the scan
        limits: [-5.0, 5.0]        # a channel at or beyond them is saturated
        valid: is_ok               # a field that is false, or 0, while the sensor is invalid
        stamp: header.stamp        # default: the header's stamp, or the time of receipt
    max_age_s: 0.05                # older values of the other phalanges are missing

Known types need no ``fields``. Values that are not finite are missing.
"""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tactile_localizer.channels import DEFAULT_CHANNELS, ChannelLayout
from tactile_localizer.errors import MeasurementError, ParameterError
from tactile_localizer.io.status import MISSING, OK, SATURATED
from tactile_localizer.io.yaml_file import load_yaml, mapping
from tactile_localizer.quantity import number, whole_number
from tactile_localizer.scene import MOST_CHANNELS

_FORCES = tuple(f"{part}.{axis}" for part in ("force", "torque") for axis in "xyz")
KNOWN_FIELDS = {
    "std_msgs/msg/Float32MultiArray": ("data",),
    "std_msgs/msg/Float64MultiArray": ("data",),
    "geometry_msgs/msg/Wrench": _FORCES,
    "geometry_msgs/msg/WrenchStamped": tuple(f"wrench.{field}" for field in _FORCES),
}
"""Default fields of the channels, by message type."""

_SEGMENT = re.compile(r"([A-Za-z_]\w*)(?:\[(\d+)(?::(\d+))?\])?")
_TYPE = re.compile(r"[A-Za-z]\w*/msg/[A-Za-z]\w*")

_HISTORY_SAMPLES = 64
"""Newest values kept per phalanx, to be matched with the stamps of the first one: 64 ms at 1 kHz."""

_NANOSECONDS = 1_000_000_000


@dataclass(frozen=True)
class FieldPath:
    """Path to a field of a message, such as ``wrench.force.x``, ``data`` or ``data[0:16]``."""

    text: str

    def __post_init__(self) -> None:
        if not all(_SEGMENT.fullmatch(segment) for segment in self.text.split(".")):
            raise ParameterError(f"field {self.text!r}: expected a path such as wrench.force.x or data[0:16]")

    @cached_property
    def steps(self) -> list[tuple[str, int | slice | None]]:
        """Names of nested fields, each with the index or the part of its array."""
        steps: list[tuple[str, int | slice | None]] = []
        for name, first, end in _SEGMENT.findall(self.text):
            steps.append((name, slice(int(first), int(end)) if end else int(first) if first else None))
        return steps

    @property
    def size(self) -> int | None:
        """Number of values at the path; ``None`` for a number or an array of unknown length."""
        _, part = self.steps[-1]
        return part.stop - part.start if isinstance(part, slice) else None

    def of(self, message: Any) -> Any:
        """Value at the path in a message.

        Raises
        ------
        MeasurementError
            The message does not have the field.
        """
        value = message
        try:
            for name, part in self.steps:
                value = getattr(value, name)
                value = value if part is None else value[part]
        except (AttributeError, IndexError, TypeError):
            raise MeasurementError(f"field {self.text}: expected it in the message, found none") from None
        return value


@dataclass(frozen=True)
class StrainSource:
    """Source of the channels of one phalanx.

    Parameters
    ----------
    phalanx : name of the phalanx
    topic, kind : topic and type of the messages, such as ``geometry_msgs/msg/WrenchStamped``
    fields : fields of the channels, in their order
    channels : number of channels
    scale : factor to the unit of the scan
    limits : ends of the range, in that unit, at which a channel is saturated
    valid : field that is false while the sensor is invalid
    stamp : field with the stamp; ``None``: the header's stamp, or the time of receipt
    """

    phalanx: str
    topic: str
    kind: str
    fields: tuple[FieldPath, ...]
    channels: int
    scale: float = 1.0
    limits: tuple[float, float] = (-math.inf, math.inf)
    valid: FieldPath | None = None
    stamp: FieldPath | None = None

    def read(self, message: Any) -> tuple[np.ndarray, int]:
        """Values (channels,) and status bits of a message.

        Raises
        ------
        MeasurementError
            The message lacks a field, or has a different number of channels.
        """
        parts = [np.ravel(np.asarray(path.of(message), dtype=np.float64)) for path in self.fields]
        values = self.scale * np.concatenate(parts)
        if len(values) != self.channels:
            raise MeasurementError(
                f"{self.topic}: expected {self.channels} channels for phalanx {self.phalanx}, "
                f"got {len(values)}"
            )
        if not np.isfinite(values).all() or (self.valid is not None and not self.valid.of(message)):
            return np.full(self.channels, np.nan), MISSING
        saturated = (values <= self.limits[0]) | (values >= self.limits[1])
        return values, SATURATED if saturated.any() else OK

    def stamp_ns(self, message: Any, received_ns: int) -> int:
        """Stamp of a message, ns; the time of receipt if the stamp is zero or missing."""
        stamp = self.stamp.of(message) if self.stamp is not None else _header_stamp(message)
        if stamp is None:
            return received_ns
        return int(stamp.sec) * _NANOSECONDS + int(stamp.nanosec) or received_ns


class StrainVector(NamedTuple):
    """Stamp (ns), strain (C,) with NaN where missing, and status (F,) of all phalanges."""

    stamp_ns: int
    strain: np.ndarray
    status: np.ndarray


class StrainAdapter:
    """Converts messages to strain vectors, one per message of the first phalanx.

    The other phalanges contribute their newest values that are not later than its stamp.

    Parameters
    ----------
    sources : one per phalanx, in the order of the strain vector
    max_age_s : age beyond which the values of another phalanx are missing, s
    """

    def __init__(self, sources: Sequence[StrainSource], max_age_s: float = 0.05) -> None:
        self.sources = tuple(sources)
        self.phalanges = tuple(source.phalanx for source in sources)
        self.layout = ChannelLayout(tuple(source.channels for source in sources))
        self.topics = {source.topic: source.kind for source in sources}
        self._max_age_ns = round(max_age_s * _NANOSECONDS)
        self._kept: list[deque[tuple[int, np.ndarray, int]]] = [
            deque(maxlen=_HISTORY_SAMPLES) for _ in sources
        ]

    def feed(self, topic: str, message: Any, received_ns: int) -> StrainVector | None:
        """Process a message; returns a strain vector if it belongs to the first phalanx.

        Raises
        ------
        MeasurementError
            The message lacks a field, or has a different number of channels.
        """
        vector = None
        for index in reversed(range(len(self.sources))):  # first phalanx last: others may share its message
            source = self.sources[index]
            if source.topic != topic:
                continue
            stamp_ns = source.stamp_ns(message, received_ns)
            kept = self._kept[index]
            if kept and stamp_ns <= kept[-1][0]:
                if kept[-1][0] - stamp_ns < _NANOSECONDS:
                    continue  # late or duplicate
                self.reset()  # backward jump of the clock
            kept.append((stamp_ns, *source.read(message)))
            if index == 0:
                vector = self._vector(stamp_ns)
        return vector

    def reset(self) -> None:
        """Forget all values."""
        for kept in self._kept:
            kept.clear()

    def _vector(self, stamp_ns: int) -> StrainVector:
        strain = np.full(self.layout.size, np.nan)
        status = np.full(len(self.sources), MISSING, dtype=np.uint8)
        for index, (channels, kept) in enumerate(zip(self.layout.slices, self._kept, strict=True)):
            earlier = (sample for sample in reversed(kept) if sample[0] <= stamp_ns)
            newest_ns, values, bits = next(earlier, (-math.inf, strain[channels], MISSING))
            if stamp_ns - newest_ns <= self._max_age_ns:
                strain[channels], status[index] = values, bits
        return StrainVector(stamp_ns, strain, status)


def load_adapter(path: str | Path) -> StrainAdapter:
    """Read an adapter from a YAML file.

    Raises
    ------
    ParameterError
        The file is missing or invalid.
    """
    return load_yaml(path, "a strain adapter in YAML", ParameterError, adapter_from_dict)


def adapter_from_dict(content: Any) -> StrainAdapter:
    """Make an adapter from its YAML form.

    Raises
    ------
    ParameterError
        A key is missing or unknown, or a value is of the wrong kind.
    """
    mapping(content, "adapter", ("phalanges", "max_age_s"))
    entries = mapping(content.get("phalanges"), "phalanges")
    if not entries:
        raise ParameterError("phalanges: expected an entry per phalanx, got none")
    sources = [_source(str(name), entry) for name, entry in entries.items()]
    for source in sources:
        other = next(each for each in sources if each.topic == source.topic)
        if other.kind != source.kind:
            raise ParameterError(f"topic {source.topic}: expected one type, got {other.kind}, {source.kind}")
    return StrainAdapter(sources, number(content.get("max_age_s", 0.05), "max_age_s", lower=0.0, upper=10.0))


def _source(phalanx: str, entry: Any) -> StrainSource:
    what = f"phalanx {phalanx}"
    mapping(entry, what, ("topic", "type", "fields", "channels", "scale", "limits", "valid", "stamp"))
    if "topic" not in entry:
        raise ParameterError(f"{what}: expected topic, found none")
    kind = str(entry.get("type"))
    if not _TYPE.fullmatch(kind):
        raise ParameterError(f"{what} type: expected PACKAGE/msg/NAME, got {kind!r:.80}")
    given = entry.get("fields", KNOWN_FIELDS.get(kind))
    if not isinstance(given, list | tuple) or not given:
        raise ParameterError(f"{what} fields: expected a list of paths into {kind}, got {given!r:.80}")
    fields = tuple(FieldPath(str(path)) for path in given)
    limits = entry.get("limits", [-math.inf, math.inf])
    if not isinstance(limits, list) or len(limits) != 2:
        raise ParameterError(f"{what} limits: expected [lowest, highest], got {limits!r:.80}")
    return StrainSource(
        phalanx=phalanx,
        topic=str(entry["topic"]),
        kind=kind,
        fields=fields,
        channels=_channels(entry, what, fields),
        scale=number(entry.get("scale", 1.0), f"{what} scale"),
        limits=(
            number(limits[0], f"{what} limits", finite=False),
            number(limits[1], f"{what} limits", finite=False),
        ),
        valid=FieldPath(str(entry["valid"])) if "valid" in entry else None,
        stamp=FieldPath(str(entry["stamp"])) if "stamp" in entry else None,
    )


def _channels(entry: Mapping[str, Any], what: str, fields: Sequence[FieldPath]) -> int:
    """Number of channels: as given, as the paths imply, or the default for an array of unknown length."""
    if "channels" in entry:
        return whole_number(entry["channels"], f"{what} channels", lower=1, upper=MOST_CHANNELS)
    if len(fields) == 1 and fields[0].size is None and fields[0].text.split(".")[-1] == "data":
        return DEFAULT_CHANNELS
    return sum(path.size or 1 for path in fields)


def _header_stamp(message: Any) -> Any:
    return getattr(getattr(message, "header", None), "stamp", None)
