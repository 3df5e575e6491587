"""Values of a field of a message, of rclpy or rosbags, with the names that the message gives them.

A field is a path with dots: of an array of messages it means that of each, or of the one whose number stands
in the path; a message of numbers gives all its fields. The data of an image and of a point cloud are decoded.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from tactile_localizer.errors import MeasurementError, listed

Named = tuple[str, Any]
"""The name of a value or of an array of values, empty without one, and the value or the array."""

_ENCODING = re.compile(r"(8|16|32|64)([USF])(?:C([0-9]+)|)|(mono|bayer_[a-z]+|rgb|bgr|rgba|bgra)(8|16)")
_COLOURS = {"rgb": 3, "bgr": 3, "rgba": 4, "bgra": 4}
_CLOUD_KINDS = ("", "i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")
"""Types of the fields of a ``PointCloud2``, by their numbers."""


def values_of(message: Any, field: str) -> tuple[np.ndarray, tuple[str, ...]]:
    """Values (n,) of a field, and their names, n or none.

    Raises
    ------
    MeasurementError
        The data of an image or a cloud cannot be decoded.
    AttributeError, IndexError, TypeError, ValueError
        The message has no such field, or it holds no numbers.
    """
    found = [(name, _numbers(value)) for name, value in _values(message, field.split("."), "")]
    values = np.concatenate([np.empty(0), *(numbers for _, numbers in found)])
    names = [name for name, numbers in found for _ in range(len(numbers))]
    return values, tuple(names) if all(names) else ()


def _values(value: Any, path: Sequence[str], label: str) -> Iterator[Named]:
    if path and path[0].isdecimal():
        yield from _values(value[int(path[0])], path[1:], label)
    elif isinstance(value, list) and (path or (value and _fields(value[0]))):
        for each in value:
            yield from _values(each, path, label)
    elif not path:
        fields = _fields(value)
        if not fields:
            yield label, value
        for field in fields:
            yield from _member(value, field, (), label)
    else:
        yield from _member(value, path[0], path[1:], label)


def _member(message: Any, field: str, path: Sequence[str], label: str) -> Iterator[Named]:
    """The values of a field, each element of which may have a name in an array of names beside it."""
    value = _read(message, field)
    names = _names_of(message, value)
    if not names:
        yield from _values(value, path, label)
        return
    rest, chosen = path, range(len(names))
    if path and path[0].isdecimal():
        rest, chosen = path[1:], range(int(path[0]), int(path[0]) + 1)
    for place in chosen:
        yield from _values(value[place], rest, f"{label}/{names[place]}" if label else names[place])


def _names_of(message: Any, value: Any) -> list[str]:
    """Names of the elements of an array: those in an array of the message, or those that they have."""
    if isinstance(value, str | bytes) or not hasattr(value, "__len__") or not len(value):
        return []
    for field in _fields(message):
        beside = getattr(message, field)
        if isinstance(beside, list) and len(beside) == len(value) and isinstance(beside[0], str):
            return beside if beside is not value else []
    if isinstance(value, list):
        names = [getattr(each, "name", "") for each in value]
        return names if all(isinstance(name, str) and name for name in names) else []
    return []


def _fields(value: Any) -> list[str]:
    """Names of the fields of a message; none of another value."""
    if hasattr(value, "get_fields_and_field_types"):  # received by rclpy; those of rosbags have a __dict__
        return list(value.get_fields_and_field_types())
    return [field for field in getattr(value, "__dict__", ()) if not field.startswith("_")]


def _read(message: Any, field: str) -> Any:
    """A field, where bytes are data decoded."""
    if hasattr(message, "point_step"):
        return _cloud(message, field)
    value = getattr(message, field)
    if field == "data" and hasattr(message, "encoding") and hasattr(message, "step"):
        return _image(message)
    if field == "data" and isinstance(getattr(message, "format", None), str):
        raise MeasurementError(
            f"expected values in data, found {message.format!r:.40} bytes, which are compressed"
        )
    return value


def _image(message: Any) -> np.ndarray:
    """Pixels (height * width * channels,) of a ``sensor_msgs/Image``."""
    match = _ENCODING.fullmatch(message.encoding)
    if match is None:
        raise MeasurementError(f"expected encoding mono8, 16UC1 or alike, found {message.encoding!r:.40}")
    bits, kind, channels, colour, colour_bits = match.groups()
    size, width = int(bits or colour_bits) // 8, message.width * int(channels or _COLOURS.get(colour, 1))
    data = np.array(message.data, np.uint8)
    if len(data) != message.height * message.step or width * size > message.step:
        expected = f"{message.height} rows of {message.width} pixels in {message.step} bytes each"
        raise MeasurementError(f"expected {expected} of encoding {message.encoding}, found {len(data)} bytes")
    letter = {"S": "i", "F": "f"}.get(kind, "u")
    rows = data.reshape(message.height, message.step)[:, : width * size]
    return np.frombuffer(rows.tobytes(), f"{'<>'[bool(message.is_bigendian)]}{letter}{size}")


def _cloud(message: Any, field: str) -> np.ndarray:
    """Values of a field of the points of a ``sensor_msgs/PointCloud2``."""
    fields = {each.name: each for each in message.fields}
    if field not in fields:
        raise MeasurementError(f"expected one of {listed(fields)}, which the points have, got {field!r:.40}")
    one = fields[field]
    kind = f"{'<>'[bool(message.is_bigendian)]}{_CLOUD_KINDS[one.datatype]}"
    points = np.dtype(
        {
            "names": [field],
            "formats": [(kind, (max(one.count, 1),))],
            "offsets": [one.offset],
            "itemsize": message.point_step,
        }
    )
    rows = np.array(message.data, np.uint8).reshape(message.height, message.row_step)
    data = rows[:, : message.width * message.point_step].tobytes()
    return np.frombuffer(data, points)[field].ravel()


def _numbers(value: Any) -> np.ndarray:
    """Numbers (n,) of a value or an array; rclpy has a byte as ``bytes``."""
    if isinstance(value, bytes):
        value = list(value)
    elif isinstance(value, list) and value and isinstance(value[0], bytes):
        value = list(b"".join(value))
    numbers = np.atleast_1d(np.asarray(value))
    if numbers.dtype.kind not in "biuf" or numbers.ndim > 1:
        raise ValueError("expected numbers")
    return numbers.astype(np.float64)


def with_names(wanted: Iterable[str], names: Sequence[str]) -> list[int]:
    """Places of all values with each of the ``wanted`` names; empty if none of them is there.

    Raises
    ------
    MeasurementError
        Only some of the names are there.
    """
    places: dict[str, list[int]] = {}
    for place, name in enumerate(names):
        places.setdefault(name, []).append(place)
    missing = [name for name in wanted if name not in places]
    if missing and any(name in places for name in wanted):
        raise MeasurementError(f"expected a value named {listed(missing)}, found {listed(places)}")
    return [] if missing else [place for name in wanted for place in places[name]]
