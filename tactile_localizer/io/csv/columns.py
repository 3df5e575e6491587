"""Naming of CSV columns: maps this package's quantities to column names, in YAML or on the command line.

For example::

    stamp_s: timestamp * 0.001      # column * factor to the package's unit
    x: position_mm * 0.001
    index: gauge1..8                # a phalanx: one column per channel
    middle: [a, b, c, d, e, f, g, h]
    strain_unit: counts             # default: V
    speed: {x: 0.01}                # m/s, if no column holds the position

Quantities without an entry have their standard names: ``stamp_s``, ``sweep``, the axis, ``index_1``,
``index_2``, .... ``pose_stamp_s`` names the stamps of a separate file of poses if they differ.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Any

from tactile_localizer.channels import DEFAULT_CHANNELS
from tactile_localizer.errors import ParameterError, ScanError
from tactile_localizer.io.yaml_file import load_yaml, mapping
from tactile_localizer.quantity import number
from tactile_localizer.scene import AXIS_NAMES, MOST_CHANNELS, Phalanx, Scene

_RANGE = re.compile(r"(.*?)(\d{1,9})\.\.(\d{1,9})")
_MAX_RANGE_COLUMNS = 1024
"""Most columns in a range such as ``gauge1..8``; bounds the list of names that it expands to."""

_GENERAL = ("stamp_s", "pose_stamp_s", "sweep")
_MAX_LISTED_NAMES = 20
"""Most column names listed in a message."""


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

    @property
    def phalanges(self) -> tuple[str, ...]:
        """Names that are neither an axis nor a general quantity."""
        return tuple(name for name in self.columns if name not in (*_GENERAL, *AXIS_NAMES))

    def check(self, scene: Scene) -> None:
        """Require that the naming matches a scene.

        Raises
        ------
        ScanError
            It names a quantity that the scene does not have, or a wrong number of columns for a phalanx.
        """
        channels = {phalanx.name: phalanx.channels for phalanx in scene.phalanges}
        for axis in self.speed:
            if axis not in scene.axis_names:
                raise ScanError(f"speed of axis {axis!r}: expected one of {', '.join(scene.axis_names)}")
        for quantity, columns in self.columns.items():
            if quantity not in (*_GENERAL, *scene.axis_names, *channels):
                known = ", ".join((*_GENERAL, *scene.axis_names, *channels))
                raise ScanError(f"column naming {quantity!r}: expected one of {known}, strain_unit, speed")
            expected, found = channels.get(quantity, 1), len(columns.names)
            if found != expected:
                remedy = f"; or write channels: {found} below {quantity} in the scene"
                raise ScanError(
                    f"column naming {quantity!r}: expected {expected} columns, got {found}"
                    + remedy * (quantity in channels)
                )


class MissingColumnError(ScanError):
    """A file without a column that is needed.

    Parameters
    ----------
    message : what is missing and what was found
    template : a column naming in YAML for the user to fill in
    """

    def __init__(self, message: str, template: str) -> None:
        super().__init__(message)
        self.template = template


def missing_column(
    path: Path, header: Sequence[str], quantity: str, naming: ColumnNaming, scene: Scene | None
) -> MissingColumnError:
    """Error about a quantity without a column, with a naming to fill in."""
    axes = scene.axis_names if scene else tuple(naming.speed) or ("x",)
    counts = phalanges_in(header, naming) or {"finger": DEFAULT_CHANNELS}
    counts = {each.name: each.channels for each in scene.phalanges} if scene else counts
    hints = {"stamp_s": "time of the row, s; from ms: NAME * 0.001"}
    hints |= dict.fromkeys(axes, "position of the palm, m; from mm: NAME * 0.001")
    hints |= {name: f"{count} columns: NAME1..{count}, or [NAME, ...]" for name, count in counts.items()}
    lines = [f"# columns found: {listed(header)}"]
    entries = dict(_entries(naming))
    for name, hint in hints.items():
        if name not in naming.speed and not standard_channels(header, name):
            column = entries.get(name, name if name in header else "")
            lines.append(f"{name}: {column}".ljust(24) + f"  # {hint}")
    name = ", ".join(naming.columns[quantity].names) if quantity in naming.columns else quantity
    example = f"{quantity}=NAME{'1..8' * (quantity not in (*_GENERAL, *AXIS_NAMES))}"
    return MissingColumnError(
        f"{path}: expected a column for {quantity} ({name}), found {listed(header) or 'no header'}; "
        f"fill in the naming above and pass it by --columns FILE, or pass --column {example}",
        "\n".join(lines),
    )


def phalanges_in(header: Sequence[str], naming: ColumnNaming) -> dict[str, int]:
    """Number of channels of each phalanx that a naming or numbered columns ``<phalanx>_1``, ... give."""
    counts = {name: len(naming.columns[name].names) for name in naming.phalanges}
    used = {column for columns in naming.columns.values() for column in columns.names}
    for column in header:
        phalanx = column.removesuffix("_1")
        if phalanx not in ("", column) and column not in used:
            counts.setdefault(phalanx, min(standard_channels(header, phalanx), MOST_CHANNELS))
    return counts


def listed(names: Sequence[str]) -> str:
    """Column names for a message, with numbered ones as a range, cut to a reasonable number and length."""
    shown: list[str] = []
    for name in names:
        prefix = name.rstrip("0123456789")
        number = name[len(prefix) :]
        first, _, last = shown[-1].partition(" to ") if shown else ("", "", "")
        if prefix and number and (last or first) == f"{prefix}{int(number[:9]) - 1}":
            shown[-1] = f"{first} to {name}"
        else:
            shown.append(name.strip()[:40])
    more = len(shown) - _MAX_LISTED_NAMES
    return ", ".join(shown[:_MAX_LISTED_NAMES]) + (f" and {more} more" if more > 0 else "")


def channel_names(phalanx: str, channels: int) -> tuple[str, ...]:
    """Standard column names of a phalanx: ``index_1``, ``index_2``, ..."""
    return tuple(f"{phalanx}_{channel}" for channel in range(1, channels + 1))


def standard_channels(header: Sequence[str], phalanx: str) -> int:
    """Number of columns ``<phalanx>_1``, ``<phalanx>_2``, ... without a gap."""
    names = set(header)
    count = 0
    while f"{phalanx}_{count + 1}" in names:
        count += 1
    return count


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
    try:
        entries = {str(name): value for name, value in mapping(content, "column naming").items()}
        unit, speed = str(entries.pop("strain_unit", "V")), mapping(entries.pop("speed", {}), "speed")
        speeds = {str(axis): number(value, f"speed of axis {axis!r}") for axis, value in speed.items()}
    except ParameterError as error:
        raise ScanError(str(error)) from None
    return ColumnNaming({name: _columns(name, value) for name, value in entries.items()}, unit, speeds)


def naming_to_dict(naming: ColumnNaming) -> dict[str, Any]:
    """YAML form of a naming, made of plain mappings, lists and strings."""
    content: dict[str, Any] = dict(_entries(naming))
    if naming.strain_unit != "V":
        content["strain_unit"] = naming.strain_unit
    return content | ({"speed": dict(naming.speed)} if naming.speed else {})


def _entries(naming: ColumnNaming) -> Iterator[tuple[str, Any]]:
    for quantity, columns in naming.columns.items():
        factor = "" if columns.scale == 1 else f" * {columns.scale}"
        names = [name + factor for name in columns.names]
        yield quantity, names[0] if len(names) == 1 else names


def naming_from_pairs(pairs: Sequence[str], base: ColumnNaming) -> ColumnNaming:
    """Override a naming with ``QUANTITY=COLUMNS`` arguments of the command line.

    Raises
    ------
    ScanError
        An argument has a different form.
    """
    content: dict[str, Any] = {"strain_unit": base.strain_unit}
    for pair in pairs:
        quantity, equals, value = pair.partition("=")
        if not (quantity and equals and value):
            raise ScanError(f"column {pair!r}: expected QUANTITY=COLUMN, as in stamp_s=time_ms*0.001")
        content[quantity.strip()] = value.split(",") if "," in value else value
    given = naming_from_dict(content)
    return ColumnNaming({**base.columns, **given.columns}, given.strain_unit, {**base.speed, **given.speed})


def _columns(quantity: str, value: Any) -> Columns:
    """Columns of ``NAME``, ``NAME1..8``, either with a factor, or of a list of such."""
    if isinstance(value, list) and value:
        parts = [_columns(quantity, each) for each in value if not isinstance(each, list)]
        if len(parts) == len(value) and len({part.scale for part in parts}) == 1:
            return Columns(tuple(name for part in parts for name in part.names), parts[0].scale)
    if not isinstance(value, str):
        raise ScanError(
            f"column naming {quantity!r}: expected a column's name or a list of names, got {value!r:.80}"
        )
    name, star, factor = (part.strip() for part in value.partition("*"))
    try:
        scale = Decimal(factor) if star else Decimal(1)
    except InvalidOperation:
        scale = Decimal(0)
    if not scale.is_finite() or scale == 0:
        raise ScanError(
            f"column naming {quantity!r}: expected a number after *, other than 0, got {factor!r:.80}"
        )
    match = _RANGE.fullmatch(name)
    if match is None:
        return Columns((name,), scale)
    prefix, first, last = match.group(1), int(match.group(2)), int(match.group(3))
    if not 0 <= last - first < _MAX_RANGE_COLUMNS:
        raise ScanError(
            f"column naming {quantity!r}: expected 1 to {_MAX_RANGE_COLUMNS} columns, got {name!r:.80}"
        )
    return Columns(tuple(f"{prefix}{index}" for index in range(first, last + 1)), scale)
