"""Conversion of wrenches, arrays of numbers and images to strain vectors, described in YAML.

One entry per phalanx; each message of the first phalanx gives one strain vector::

    phalanges:
      index:
        topic: /wrench
        type: geometry_msgs/msg/WrenchStamped   # six channels
        frame: left_ft             # of several sensors on the topic; default: any
      middle:
        topic: /skin
        type: skin_msgs/msg/Taxels
        field: pressure.values     # numbers; names as in tactile_localizer.io.names; default: data
        values: [0..5, 8]          # places of those that are taken, from 0; default: all
        scale: 0.001               # factor to the unit of the scan; default: 1
        stamp: receipt             # of a sensor that counts from its start; default: header
      thumb:
        topic: /joint_states
        type: sensor_msgs/msg/JointState
        field: effort
        names: [joint_0..5]        # of a message that names its values
        empty: 0                   # of a message without values, as of no contact
    max_age_s: 0.05                # values of other phalanges that are further away in time are missing
    stamp: header                  # of all phalanges

``channels`` is the number of values, by default that of ``values`` or ``names``, or 8. The stamp is that of
the header, or the time of receipt where it has none. Values that are not finite are missing.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tactile_localizer.channels import DEFAULT_CHANNELS, ChannelLayout
from tactile_localizer.errors import MeasurementError, ParameterError, did_you_mean, listed
from tactile_localizer.io.message_values import values_of, with_names
from tactile_localizer.io.names import Names, parse_names, ranges
from tactile_localizer.io.status import missing_status
from tactile_localizer.io.yaml_file import load_yaml, mapping
from tactile_localizer.quantity import number, whole_number
from tactile_localizer.scene import MOST_CHANNELS
from tactile_localizer.streams.runs import LATE, NANOSECONDS, STRAIN, Runs, to_ns
from tactile_localizer.streams.sources import describe_sources

WRENCH = "geometry_msgs/msg/WrenchStamped"
_ARRAYS = (
    "Float32",
    "Float64",
    "Int8",
    "Int16",
    "Int32",
    "Int64",
    "UInt8",
    "UInt16",
    "UInt32",
    "UInt64",
    "Byte",
)
_FIELDS = {
    WRENCH: "wrench",
    "sensor_msgs/msg/Image": "data",
    **{f"std_msgs/msg/{kind}MultiArray": "data" for kind in _ARRAYS},
}
"""Types that need no field."""
_KEYS = ("topic", "type", "field", "channels", "scale", "names", "values", "empty", "frame", "stamp")
_HEADER, _RECEIPT = "header", "receipt"
_SILENT_NS = NANOSECONDS
"""Time without messages of the sensor that is taken after which another one is, ns (judgement)."""


@dataclass(frozen=True)
class StrainSource:
    """Source of the channels of one phalanx.

    Parameters
    ----------
    phalanx : name of the phalanx
    topic, kind : topic and type of the messages
    field : fields of the values, with dots between nested fields; of an array of messages, that of each, or
        of one, whose number from 0 stands in place of a name. A message of numbers gives all its fields
    channels : number of channels
    scale : factor to the unit of the scan
    names : names of the values that are taken, of a message that has names; empty: by their places
    places : places of the values that are taken, from 0; empty: all
    empty : all values of a message without any; ``None``: it is refused
    frame : frame in the header of the messages that are taken; empty: any
    stamp : ``header``, or ``receipt``
    """

    phalanx: str
    topic: str
    kind: str
    field: Names
    channels: int
    scale: float = 1.0
    names: tuple[str, ...] = ()
    places: tuple[int, ...] = ()
    empty: float | None = None
    frame: str = ""
    stamp: str = _HEADER

    def read(self, message: Any) -> tuple[np.ndarray | None, tuple[str, ...], str]:
        """Values (channels,) of a message, which need not be finite, and names and form of all its values.

        The form is their number and encoding; empty without any. ``None`` in place of the values: the
        message has none of the wanted names, it is another device's.

        Raises
        ------
        MeasurementError
            The message lacks the field or a name, or it has a different number of values.
        """
        try:
            found = [values_of(message, name) for name in self.field.names]
        except MeasurementError as error:
            raise MeasurementError(f"{self.topic}: {error}") from None
        except (AttributeError, IndexError, TypeError, ValueError):
            if self.empty is not None and not self._has_elements(message):
                return np.full(self.channels, self.scale * self.empty), (), ""
            text = f"expected numbers in field {', '.join(self.field.names)}"
            raise MeasurementError(f"{self.topic}: {text}") from None
        factors = [self.scale * float(factor) for factor in self.field.factors]
        values = np.concatenate([factor * each for factor, (each, _) in zip(factors, found, strict=True)])
        names = tuple(name for _, each in found for name in each)
        names = names if len(names) == len(values) else ()
        if self.empty is not None and not len(values):
            return np.full(self.channels, self.scale * self.empty), names, ""
        try:
            chosen = self._chosen(values, names)
        except MeasurementError as error:
            raise MeasurementError(f"{self.topic}: {error}{_pixels(message)}") from None
        encoding = getattr(message, "encoding", "")
        return chosen, names, f"{len(values)} values" + f" of encoding {encoding}" * bool(encoding)

    def _chosen(self, values: np.ndarray, names: Sequence[str]) -> np.ndarray | None:
        """The values of the phalanx; errors as :meth:`read`."""
        if self.names:
            if not (places := with_names(self.names, names)):
                return None
            values = values[places]
        elif self.places:
            if max(self.places) >= len(values):
                expected = f"expected more than {max(self.places)} values for phalanx {self.phalanx}"
                raise MeasurementError(f"{expected}, got {len(values)}")
            values = values[list(self.places)]
        if len(values) != self.channels:
            text = f"expected {self.channels} channels for phalanx {self.phalanx}, got {len(values)}"
            raise MeasurementError(text)
        return values

    def _has_elements(self, message: Any) -> bool:
        """Whether the array that the first field is in has any element."""
        for name in self.field.names[0].split("."):
            if name.isdecimal():
                return len(message) > 0
            message = getattr(message, name, (None,))
        return True


def _pixels(message: Any) -> str:
    """The size of an image, for a message."""
    if not hasattr(message, "encoding"):
        return ""
    return f" ({message.height} rows of {message.width} pixels of encoding {message.encoding})"


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

    Attributes
    ----------
    identities : what messages have arrived on each topic since the last :meth:`findings`: their frame, and
        the names of their values
    names : names of the values that are taken by their places, by phalanx, where the messages have some
    forms : number and encoding of all values of the messages, by phalanx, of which places are taken
    ahead_ns : how far the newest stamp of each topic is ahead of its receipt, ns
    """

    def __init__(self, sources: Sequence[StrainSource], max_age_s: float = 0.05) -> None:
        self.sources = tuple(sources)
        self.phalanges = tuple(source.phalanx for source in sources)
        self.layout = ChannelLayout(tuple(source.channels for source in sources))
        self.topics = {source.topic: source.kind for source in sources}
        self._max_age_ns = round(max_age_s * NANOSECONDS)
        self.names: dict[str, tuple[str, ...]] = {}
        self.forms: dict[str, str] = {}
        self.reset()

    def feed(self, topic: str, message: Any, received_ns: int) -> StrainVector | None:
        """Process a message; returns a strain vector if it belongs to the first phalanx and is not late.

        Raises
        ------
        MeasurementError
            The message lacks a field or a name, has a different number of channels, or other names, another
            number or another encoding of its values than before.
        """
        header = getattr(message, "header", None)
        frame = str(getattr(header, "frame_id", ""))
        stamp = getattr(header, "stamp", None)
        header_ns = to_ns(stamp) if stamp is not None else 0
        self.ahead_ns[topic] = header_ns - received_ns if header_ns else 0
        taken: dict[int, tuple[int, np.ndarray]] = {}
        for index, source in enumerate(self.sources):
            if source.topic == topic:
                values, names, form = source.read(message)
                self.identities.setdefault(topic, set()).add((frame, names))
                if values is not None and self._is_taken(index, frame, received_ns):
                    self._require_same(index, names, form)
                    self._values[index] += 1
                    self._invalid[index] += ~np.isfinite(values)
                    values = values if np.isfinite(values).all() else np.full_like(values, np.nan)
                    taken[index] = (header_ns if source.stamp == _HEADER else 0) or received_ns, values
        if 0 in taken and self._runs.add(STRAIN, taken[0][0]) == LATE:
            self._late += 1
            return None
        self._newest |= taken
        return self._vector(taken[0][0]) if 0 in taken else None

    def reset(self) -> None:
        """Forget all values, but not how the messages name them."""
        self._newest: dict[int, tuple[int, np.ndarray]] = {}
        self._runs = Runs()
        self._frames: dict[int, tuple[str, int]] = {}
        self.ahead_ns: dict[str, int] = {}
        self._forget()

    def expect(self, names: Mapping[str, Sequence[str]]) -> "StrainAdapter":
        """An adapter that takes values by the names that they had, by phalanx, where it gives no other."""
        sources = [
            replace(source, names=tuple(dict.fromkeys(names[source.phalanx])))
            if names.get(source.phalanx) and not (source.names or source.places)
            else source
            for source in self.sources
        ]
        return StrainAdapter(sources, self._max_age_ns / NANOSECONDS)

    def findings(self) -> list[str]:
        """What is wrong with the values of the messages since the last call, one line for each kind."""
        found = [*self._unread(), *self._missing(), *self._unlisted(), *self._left_out()]
        self._forget()
        return found

    def mixed(self, topic: str, nodes: Sequence[str] = ()) -> str:
        """More sources of a topic than can be told apart, in one line; empty if there are not.

        Parameters
        ----------
        topic : of messages since the last :meth:`findings`
        nodes : one for each publisher, where that is known
        """
        selected = all(source.frame or source.names for source in self.sources if source.topic == topic)
        seen = self.identities.get(topic, set())
        frames = [] if selected else sorted({frame for frame, _ in seen if frame})
        if len(frames) < 2 and len(nodes) <= max(len(seen), 1):
            return ""
        text = describe_sources(topic, nodes, frames)
        sources = enumerate(self.sources)
        taken = [self._frames[at][0] for at, one in sources if one.topic == topic and at in self._frames]
        if len(frames) > 1 and taken:
            text += f"; {taken[0]} is taken: frame in the adapter names another"
        return text

    def _forget(self) -> None:
        self.identities: dict[str, set[tuple[str, tuple[str, ...]]]] = {}
        self._values, self._late = [0] * len(self.sources), 0
        self._invalid = [np.zeros(source.channels, int) for source in self.sources]

    def _is_taken(self, index: int, frame: str, received_ns: int) -> bool:
        """Whether a message is of the frame that is taken: the given one, or the first that arrives."""
        if self.sources[index].frame:
            return frame == self.sources[index].frame
        taken, last_ns = self._frames.get(index, (frame, received_ns))
        if frame == taken or not 0 <= received_ns - last_ns <= _SILENT_NS:
            self._frames[index] = frame, received_ns
        return self._frames[index][0] == frame

    def _require_same(self, index: int, names: tuple[str, ...], form: str) -> None:
        """Require that values that are taken by their places have the names and the form that they had."""
        source = self.sources[index]
        if source.names or not form:
            return
        if (known := self.forms.setdefault(source.phalanx, form)) != form:
            raise MeasurementError(f"{source.topic}: expected {known} as before, found {form}")
        if source.places or not names:
            return
        if (before := self.names.setdefault(source.phalanx, names)) != names:
            advice = f"names: [{', '.join(before)}] in the adapter takes the values by them"
            raise MeasurementError(
                f"{source.topic}: expected names {listed(before)}, found {listed(names)}; {advice}"
            )

    def _unread(self) -> Iterator[str]:
        """Sources that none of the messages of their topic had values for."""
        for source, count in zip(self.sources, self._values, strict=True):
            if not count and (seen := self.identities.get(source.topic)):
                frames, names = zip(*sorted(seen), strict=True)
                there = listed(dict.fromkeys(frames if source.frame else sum(names, ()))) or "none"
                wanted = f"frame {source.frame}" if source.frame else f"names {listed(source.names)}"
                yield f"{source.topic}: expected {wanted} for phalanx {source.phalanx}, found {there}"

    def _missing(self) -> Iterator[str]:
        """Values that are no numbers, and how to leave them out if they never are."""
        for source, count, invalid in zip(self.sources, self._values, self._invalid, strict=True):
            never = np.flatnonzero((invalid == count) & (count > 0))
            what = f"{source.topic}: {'value' if len(never) == 1 else 'values'}"
            if 0 < len(never) < source.channels:
                kept = np.delete(np.arange(source.channels), never)
                names = [source.names[each] for each in kept] if len(source.names) == source.channels else []
                numbers = ranges(np.array(source.places or range(source.channels))[kept].tolist())
                advice = f"names: [{', '.join(names)}]" if names else f"values: [{numbers}]"
                are = "is never a number" if len(never) == 1 else "are never numbers"
                which = f"{ranges((never + 1).tolist())} of {source.phalanx} {are}"
                yield f"{what} {which}; {advice} in the adapter leaves out what is not there"
            elif len(never):
                yield f"{what} of {source.phalanx} are never numbers"
            elif (some := np.flatnonzero(invalid)).size:
                parts = [
                    f"{source.phalanx}_{each + 1} ({invalid[each]} of {count} messages)" for each in some
                ]
                yield f"{source.topic}: no number in {listed(parts)}"

    def _unlisted(self) -> Iterator[str]:
        """Values that are taken by their places although the messages name them."""
        for source in self.sources:
            if names := self.names.get(source.phalanx):
                advice = f"names: [{', '.join(names)}]" if len(set(names)) == len(names) else "names"
                yield f"{source.topic} names its values, whose order may change: {advice} takes them by name"

    def _left_out(self) -> Iterator[str]:
        """Messages of the first phalanx with the stamp of the one before, or an earlier one."""
        if self._late:
            source = self.sources[0]
            text = (
                f"{source.topic}: {self._late} of {self._values[0]} messages have stamps that do not increase"
            )
            advice = f"; stamp: {_RECEIPT} in the adapter takes the times of receipt"
            yield f"{text}, and are left out" + advice * (source.stamp == _HEADER)

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
    mapping(content, "adapter", ("phalanges", "max_age_s", "stamp"))
    entries = mapping(content.get("phalanges"), "phalanges")
    if not entries:
        raise ParameterError("phalanges: expected an entry per phalanx, got none")
    stamp = content.get("stamp", _HEADER)
    sources = [_source(str(name), entry, stamp) for name, entry in entries.items()]
    kinds: dict[str, str] = {}
    for source in sources:
        if kinds.setdefault(source.topic, source.kind) != source.kind:
            raise ParameterError(
                f"topic {source.topic}: expected one type, got {kinds[source.topic]}, {source.kind}"
            )
    return StrainAdapter(sources, number(content.get("max_age_s", 0.05), "max_age_s", lower=0.0, upper=10.0))


def _source(phalanx: str, entry: Mapping[str, Any], stamp: Any) -> StrainSource:
    what = f"phalanx {phalanx}"
    mapping(entry, what, _KEYS)
    for key in ("topic", "type"):
        if key not in entry:
            raise ParameterError(f"{what}: expected {key}, found none")
    kind = str(entry["type"])
    if not (field := entry.get("field", _FIELDS.get(kind))):
        raise ParameterError(f"{what} type: expected {kind!r:.80} with a field{did_you_mean(kind, _FIELDS)}")
    names, places = _listed(entry, "names", what), _listed(entry, "values", what)
    if wrong := [place for place in places if not place.isdecimal()]:
        raise ParameterError(f"{what} values: expected numbers from 0, as in [0..5, 7], got {wrong[0]!r:.80}")
    if names and places:
        raise ParameterError(f"{what}: expected names or values, found both")
    channels = entry.get("channels", len(names or places) or (6 if kind == WRENCH else DEFAULT_CHANNELS))
    if places and channels != len(places):
        raise ParameterError(
            f"{what} channels: expected {len(places)}, as many as values, got {channels!r:.80}"
        )
    if (stamp := entry.get("stamp", stamp)) not in (_HEADER, _RECEIPT):
        raise ParameterError(f"{what} stamp: expected {_HEADER} or {_RECEIPT}, got {stamp!r:.80}")
    return StrainSource(
        phalanx,
        str(entry["topic"]),
        kind,
        parse_names(field, f"{what} field"),
        whole_number(channels, f"{what} channels", lower=1, upper=MOST_CHANNELS),
        number(entry.get("scale", 1.0), f"{what} scale"),
        names,
        tuple(map(int, places)),
        None if entry.get("empty") is None else number(entry["empty"], f"{what} empty"),
        str(entry.get("frame", "")),
        stamp,
    )


def _listed(entry: Mapping[str, Any], key: str, what: str) -> tuple[str, ...]:
    """Names or numbers given as a text, a number, or a list of them."""
    given = entry.get(key)
    if given is None:
        return ()
    given = [
        str(each) if isinstance(each, int) else each
        for each in (given if isinstance(given, list) else [given])
    ]
    single = given[0] if len(given) == 1 else given
    found = parse_names(single, f"{what} {key}").names
    if len(set(found)) < len(found):
        raise ParameterError(f"{what} {key}: expected each once, got {listed(found)}")
    return found
