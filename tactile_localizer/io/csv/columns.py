"""Naming of CSV columns: maps this package's quantities to column names, in YAML or on the command line.

For example::

    stamp_s: timestamp * 0.001      # column * factor to the package's unit
    x: position_mm * 0.001
    index: gauge1..8                # a phalanx: one column per channel
    middle: [a, b, c, d, e, f, g, h]
    strain_unit: counts             # default: V
    speed: {x: 0.01}                # m/s, if no column holds the position

A phalanx may also be ``{columns: [a, b, ...], scale: 0.001}``. Quantities without an entry have their
standard names: ``stamp_s``, ``sweep``, the axis, ``index_1``, ``index_2``, ....
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Any

import numpy as np

from tactile_localizer.errors import ParameterError, ScanError
from tactile_localizer.io.yaml_file import load_yaml
from tactile_localizer.quantity import is_number, number
from tactile_localizer.scene import Axis, Phalanx, Scene

LENGTHS = {"mm": 0.001, "cm": 0.01, "inches": 0.0254}
"""Units of length, with their size in m."""

ANGLES = {"degrees": 0.0174533}
"""Units of angle, with their size in rad."""

TIMES = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Units of time, with their size in s."""

SI_INSIDE_FRACTION = 0.5
"""Fraction of positions inside the bounds from which they are taken to be in SI units (judgement)."""

_MIN_INSIDE_FRACTION = 0.9
"""Fraction of positions that a proposed unit has to bring inside the bounds (judgement)."""

_RANGE = re.compile(r"^(.*?)(\d+)\.\.(\d+)$")
_MAX_RANGE_COLUMNS = 1024
"""Most columns in a range such as ``gauge1..8``; bounds the list of names that it expands to."""


@dataclass(frozen=True)
class Columns:
    """Column names of one quantity, and the factor that converts them to the package's unit."""

    names: tuple[str, ...]
    scale: Decimal = Decimal(1)


@dataclass(frozen=True)
class ColumnNaming:
    """Columns with other than the standard names.

    Parameters
    ----------
    columns : columns by quantity: ``stamp_s``, ``sweep``, an axis or a phalanx
    strain_unit : unit of the strain values, for display
    speed : constant speed by axis, m/s (rad/s), for axes without a position column. The position is the
        speed times the time since the first stamp of the sweep; with negative speed the sweep ends at 0 if
        the centre of the bounds is positive
    """

    columns: Mapping[str, Columns] = field(default_factory=dict)
    strain_unit: str = "V"
    speed: Mapping[str, float] = field(default_factory=dict)

    def of(self, quantity: str) -> Columns:
        """Column of ``stamp_s``, ``sweep`` or an axis."""
        return self.columns.get(quantity, Columns((quantity,)))

    def of_phalanx(self, phalanx: Phalanx) -> Columns:
        """Columns of a phalanx, one per channel."""
        standard = Columns(channel_names(phalanx.name, phalanx.channels))
        return self.columns.get(phalanx.name, standard)

    def check(self, scene: Scene) -> None:
        """Require that the naming matches a scene.

        Raises
        ------
        ScanError
            It names a quantity that the scene does not have, or a wrong number of columns for a phalanx.
        """
        channels = {phalanx.name: phalanx.channels for phalanx in scene.phalanges}
        known = ("stamp_s", "sweep", *scene.axis_names, *scene.phalanx_names)
        for axis in self.speed:
            if axis not in scene.axis_names:
                raise ScanError(f"speed of axis {axis!r}: expected one of {', '.join(scene.axis_names)}")
        for quantity, columns in self.columns.items():
            if quantity not in known:
                raise ScanError(
                    f"column naming {quantity!r}: expected one of {', '.join(known)}, strain_unit, speed"
                )
            expected = channels.get(quantity, 1)
            if len(columns.names) != expected:
                raise ScanError(
                    f"column naming {quantity!r}: expected {expected} columns, got {len(columns.names)}"
                )


def channel_names(phalanx: str, channels: int) -> tuple[str, ...]:
    """Standard column names of a phalanx: ``index_1``, ``index_2``, ..."""
    return tuple(f"{phalanx}_{channel}" for channel in range(1, channels + 1))


def load_naming(path: str | Path) -> ColumnNaming:
    """Read a naming from a YAML file.

    Raises
    ------
    ScanError
        The file is missing or does not hold a naming.
    """
    return load_yaml(path, "a column naming in YAML", ScanError, naming_from_dict)


def naming_from_dict(content: Any) -> ColumnNaming:
    """Make a naming from its YAML form.

    Raises
    ------
    ScanError
        It is not a mapping, or an entry is neither a name nor a list of names.
    """
    if not isinstance(content, Mapping):
        raise ScanError(f"expected a mapping of names, got {content!r}")
    entries = {str(quantity): value for quantity, value in content.items()}
    unit = str(entries.pop("strain_unit", "V"))
    speed = _speed(entries.pop("speed", {}))
    columns = {quantity: _columns(quantity, value) for quantity, value in entries.items()}
    return ColumnNaming(columns, unit, speed)


def naming_to_dict(naming: ColumnNaming) -> dict[str, Any]:
    """YAML form of a naming, made of plain mappings, lists, strings and numbers."""
    content: dict[str, Any] = {
        quantity: _columns_to_yaml(columns) for quantity, columns in naming.columns.items()
    }
    if naming.strain_unit != "V":
        content["strain_unit"] = naming.strain_unit
    if naming.speed:
        content["speed"] = dict(naming.speed)
    return content


def _columns_to_yaml(columns: Columns) -> Any:
    plain = not any("*" in name or _RANGE.match(name) for name in columns.names)
    if len(columns.names) == 1 and plain:
        return columns.names[0] + ("" if columns.scale == 1 else f" * {columns.scale}")
    names = list(columns.names)
    return names if columns.scale == 1 else {"columns": names, "scale": float(columns.scale)}


def _speed(value: Any) -> dict[str, float]:
    """Validated speeds by axis, m/s (rad/s)."""
    if not isinstance(value, Mapping):
        raise ScanError(f"column naming 'speed': expected m/s by axis, as in {{x: 0.01}}, got {value!r:.80}")
    try:
        return {str(axis): number(speed, f"speed of axis {axis!r}") for axis, speed in value.items()}
    except ParameterError as error:
        raise ScanError(str(error)) from None


def naming_from_pairs(pairs: Sequence[str], base: ColumnNaming) -> ColumnNaming:
    """Override a naming with ``QUANTITY=COLUMNS`` arguments of the command line.

    Raises
    ------
    ScanError
        An argument has a different form.
    """
    content: dict[str, Any] = {}
    for pair in pairs:
        quantity, equals, value = pair.partition("=")
        if not (quantity and equals and value):
            raise ScanError(f"column {pair!r}: expected QUANTITY=COLUMN, as in stamp_s=time_ms*0.001")
        content[quantity.strip()] = value.split(",") if "," in value else value
    content.setdefault("strain_unit", base.strain_unit)
    given = naming_from_dict(content)
    return ColumnNaming({**base.columns, **given.columns}, given.strain_unit, {**base.speed, **given.speed})


def _columns(quantity: str, value: Any) -> Columns:
    if (
        isinstance(value, Mapping)
        and set(value) == {"columns", "scale"}
        and isinstance(value["columns"], list)
    ):
        return Columns(tuple(map(str, value["columns"])), _scale(quantity, "as scale", value["scale"]))
    if isinstance(value, list):
        return Columns(tuple(str(name).strip() for name in value))
    if not isinstance(value, str):
        raise ScanError(
            f"column naming {quantity!r}: expected a column's name or a list of names, got {value!r}"
        )
    name, star, factor = value.partition("*")
    scale = _scale(quantity, "after *", factor.strip()) if star else Decimal(1)
    match = _RANGE.match(name.strip())
    if match is None:
        return Columns((name.strip(),), scale)
    prefix, first, last = match.group(1), int(match.group(2)[:20]), int(match.group(3)[:20])
    if last - first >= _MAX_RANGE_COLUMNS or len(match.group(3)) > 20:
        raise ScanError(
            f"column naming {quantity!r}: expected at most {_MAX_RANGE_COLUMNS} columns, got {value!r:.80}"
        )
    return Columns(tuple(f"{prefix}{number}" for number in range(first, last + 1)), scale)


def _scale(quantity: str, place: str, value: Any) -> Decimal:
    """A scale factor, exact if its text is decimal, so that stamps since 1970 keep their nanoseconds."""
    found = number(value, "scale", finite=False) if is_number(value) else math.inf
    if math.isinf(found) or found == 0.0:
        raise ScanError(
            f"column naming {quantity!r}: expected a number {place}, other than 0, got {value!r:.80}"
        )
    try:
        return Decimal(str(value))
    except InvalidOperation:  # a multiple of pi
        return Decimal(repr(found))


def fitting_unit(axis: Axis, values: np.ndarray, units: dict[str, float]) -> tuple[str, float] | None:
    """Guess the unit of recorded positions from the bounds of their axis.

    Parameters
    ----------
    axis : axis of the scene, with bounds in m (yaw: rad)
    values : (n,) recorded positions in an unknown unit
    units : candidate units, with their size in SI units

    Returns
    -------
    unit, factor : largest unit in which most positions lie inside the bounds; ``None`` if there is none, or
        if the positions lie inside the bounds in SI units
    """
    values = values[np.isfinite(values)]
    if not len(values) or inside(axis, values) >= SI_INSIDE_FRACTION:
        return None
    fitting = [
        (factor, unit)
        for unit, factor in units.items()
        if inside(axis, factor * values) >= _MIN_INSIDE_FRACTION
    ]
    return (max(fitting)[1], max(fitting)[0]) if fitting else None


def inside(axis: Axis, values: np.ndarray) -> float:
    """Fraction of positions (n,) within the axis's bounds."""
    return float(np.mean((values >= axis.lower) & (values <= axis.upper)))
