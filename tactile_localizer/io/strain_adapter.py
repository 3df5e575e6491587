"""Conversion of wrenches and arrays of numbers to strain vectors, described in YAML.

One entry per phalanx; each message of the first phalanx gives one strain vector::

    phalanges:
      index:
        topic: /wrench
        type: geometry_msgs/msg/WrenchStamped   # six channels
      middle:
        topic: /skin
        type: skin_msgs/msg/Taxels
        field: pressure.values     # an array of numbers; default: data
        channels: 16               # its length; default: 8
        scale: 0.001               # factor to the unit of the scan; default: 1
    max_age_s: 0.05                # values of other phalanges that are further away in time are missing

The stamp is that of the header, or the time of receipt. Values that are not finite are missing.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tactile_localizer.channels import DEFAULT_CHANNELS, ChannelLayout
from tactile_localizer.errors import MeasurementError, ParameterError, did_you_mean
from tactile_localizer.io.status import missing_status
from tactile_localizer.io.yaml_file import load_yaml, mapping
from tactile_localizer.quantity import number, whole_number
from tactile_localizer.scene import MOST_CHANNELS
from tactile_localizer.streams.runs import LATE, NANOSECONDS, STRAIN, Runs, to_ns

WRENCH = "geometry_msgs/msg/WrenchStamped"
_FIELDS = {
    WRENCH: "wrench",
    "std_msgs/msg/Float32MultiArray": "data",
    "std_msgs/msg/Float64MultiArray": "data",
}
"""Types that need no field."""


@dataclass(frozen=True)
class StrainSource:
    """Source of the channels of one phalanx.

    Parameters
    ----------
    phalanx : name of the phalanx
    topic, kind : topic and type of the messages
    field : field of the values, with dots between nested fields; of an array of messages, that of each, or
        of one, whose number from 0 stands in place of a name. A message of numbers gives all its fields
    channels : number of channels
    scale : factor to the unit of the scan
    """

    phalanx: str
    topic: str
    kind: str
    field: str
    channels: int
    scale: float = 1.0

    def read(self, message: Any) -> np.ndarray:
        """Values (channels,) of a message, NaN if one is not finite.

        Raises
        ------
        MeasurementError
            The message lacks the field, or it has a different number of values.
        """
        try:
            found = _values(message, self.field.split("."))
            values = self.scale * np.hstack([[], *found]).astype(np.float64)
        except (AttributeError, IndexError, TypeError, ValueError):
            raise MeasurementError(f"{self.topic}: expected numbers in field {self.field}") from None
        if len(values) != self.channels:
            text = f"expected {self.channels} channels for phalanx {self.phalanx}, got {len(values)}"
            raise MeasurementError(f"{self.topic}: {text}")
        return values if np.isfinite(values).all() else np.full(self.channels, np.nan)


def _values(value: Any, names: Sequence[str]) -> list[Any]:
    """Values of a nested field, of every element of an array of messages, or of the one with a number."""
    name, *rest = names or ("",)
    if isinstance(value, list) and not name.isdecimal():
        return [found for each in value for found in _values(each, names)]
    if name:
        return _values(value[int(name)] if name.isdecimal() else getattr(value, name), rest)
    if hasattr(value, "get_fields_and_field_types"):  # received by rclpy; those of rosbags have a __dict__
        fields = value.get_fields_and_field_types()
    else:
        fields = [field for field in getattr(value, "__dict__", ()) if not field.startswith("_")]
    return [found for field in fields for found in _values(getattr(value, field), ())] or [value]


class StrainVector(NamedTuple):
    """Stamp (ns), strain (C,) with NaN where missing, and status (F,) of all phalanges."""

    stamp_ns: int
    strain: np.ndarray
    status: np.ndarray


class StrainAdapter:
    """Converts messages to strain vectors, one per message of the first phalanx.

    The other phalanges contribute their newest values.

    Parameters
    ----------
    sources : one per phalanx, in the order of the strain vector
    max_age_s : difference of the stamps beyond which the values of another phalanx are missing, s
    """

    def __init__(self, sources: Sequence[StrainSource], max_age_s: float = 0.05) -> None:
        self.sources = tuple(sources)
        self.phalanges = tuple(source.phalanx for source in sources)
        self.layout = ChannelLayout(tuple(source.channels for source in sources))
        self.topics = {source.topic: source.kind for source in sources}
        self._max_age_ns = round(max_age_s * NANOSECONDS)
        self.reset()

    def feed(self, topic: str, message: Any, received_ns: int) -> StrainVector | None:
        """Process a message; returns a strain vector if it belongs to the first phalanx and is not late.

        Raises
        ------
        MeasurementError
            The message lacks a field, or has a different number of channels.
        """
        stamp = getattr(getattr(message, "header", None), "stamp", None)
        stamp_ns = (to_ns(stamp) if stamp is not None else 0) or received_ns
        given = [index for index, source in enumerate(self.sources) if source.topic == topic]
        if 0 in given and self._runs.add(STRAIN, stamp_ns) == LATE:
            return None
        self._newest |= {index: (stamp_ns, self.sources[index].read(message)) for index in given}
        return self._vector(stamp_ns) if 0 in given else None

    def reset(self) -> None:
        """Forget all values."""
        self._newest: dict[int, tuple[int, np.ndarray]] = {}
        self._runs = Runs()

    def _vector(self, stamp_ns: int) -> StrainVector:
        strain = np.full(self.layout.size, np.nan)
        for index, (of_ns, values) in self._newest.items():
            if abs(stamp_ns - of_ns) <= self._max_age_ns:
                strain[self.layout.slices[index]] = values
        return StrainVector(stamp_ns, strain, missing_status(strain, self.layout))


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
    kinds: dict[str, str] = {}
    for source in sources:
        if kinds.setdefault(source.topic, source.kind) != source.kind:
            raise ParameterError(
                f"topic {source.topic}: expected one type, got {kinds[source.topic]}, {source.kind}"
            )
    return StrainAdapter(sources, number(content.get("max_age_s", 0.05), "max_age_s", lower=0.0, upper=10.0))


def _source(phalanx: str, entry: Mapping[str, Any]) -> StrainSource:
    what = f"phalanx {phalanx}"
    mapping(entry, what, ("topic", "type", "field", "channels", "scale"))
    for key in ("topic", "type"):
        if key not in entry:
            raise ParameterError(f"{what}: expected {key}, found none")
    kind = str(entry["type"])
    field = str(entry.get("field", _FIELDS.get(kind, "")))
    if not field:
        raise ParameterError(f"{what} type: expected {kind!r:.80} with a field{did_you_mean(kind, _FIELDS)}")
    channels = entry.get("channels", 6 if kind == WRENCH else DEFAULT_CHANNELS)
    return StrainSource(
        phalanx,
        str(entry["topic"]),
        kind,
        field,
        whole_number(channels, f"{what} channels", lower=1, upper=MOST_CHANNELS),
        number(entry.get("scale", 1.0), f"{what} scale"),
    )
