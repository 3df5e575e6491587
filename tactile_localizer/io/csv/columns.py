"""Naming of CSV columns: maps this package's quantities to column names, in YAML or on the command line.

For example::

    stamp_s: timestamp * 0.001              # column * factor to the package's unit
    stamp_s: sec + nanosec * 1e-9 - 1.7e9   # stamps may be a sum, and have an offset, s
    x: position_mm * 0.001
    index: gauge1..8                        # a phalanx: one column per channel
    middle: ["Force 1, N", "Force 2, N"]    # names in a list are taken as they are
    strain_unit: counts                     # default: V

A position in the column of the stamps, as ``x: timestamp * 1e-5``, is a constant speed from the start of
each sweep on. Quantities without an entry have their standard names: ``stamp_s``, ``sweep``, the axis,
``index_1``, ``index_2``, .... ``pose_stamp_s`` names the stamps of a separate file of poses if they differ.
"""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Any

from tactile_localizer.channels import DEFAULT_CHANNELS
from tactile_localizer.errors import ScanError, listed
from tactile_localizer.io.yaml_file import load_yaml, mapping
from tactile_localizer.quantity import LARGEST_NUMBER
from tactile_localizer.scene import AXIS_NAMES, MOST_CHANNELS, Scene

FELT, SWEEP = "felt", "sweep"
TRUE = {axis: f"true_{axis}" for axis in AXIS_NAMES}
"""Quantities of the true position, by axis."""
STAMPS = ("stamp_s", "pose_stamp_s")
_OTHERS = (*STAMPS, SWEEP, FELT, *AXIS_NAMES, *TRUE.values())
"""Quantities that are no phalanges."""
_LONGEST = 100
"""Characters of a name that are compared with others for a proposal."""
_RANGE = re.compile(r"(.*?)([0-9]{1,9})\.\.([0-9]{1,9})")
_SIGN = r"(?<![0-9.][eE])(?<!\*)(?<!\*\s)"
"""Before a + or - that is not part of a number."""
_OFFSET = re.compile(_SIGN + r"([-+]\s*[0-9.]+(?:[eE][-+]?[0-9]+)?)$")


@dataclass(frozen=True)
class Columns:
    """Columns of one quantity.

    Parameters
    ----------
    names : one per channel of a phalanx; those of a stamp are added up
    factors : of each column, to the package's unit
    offset : added to a stamp, s
    given : the YAML form
    """

    names: tuple[str, ...]
    factors: tuple[Decimal, ...]
    offset: Decimal = Decimal(0)
    given: str | list[str] = ""


@dataclass(frozen=True)
class ColumnNaming:
    """Columns with other than the standard names.

    Parameters
    ----------
    columns : columns by quantity: ``stamp_s``, ``sweep``, ``felt``, an axis, ``true_<axis>`` or a phalanx
    strain_unit : unit of the strain values, for display
    """

    columns: Mapping[str, Columns] = field(default_factory=dict)
    strain_unit: str = "V"

    def of(self, quantity: str, channels: int = 0) -> Columns:
        """Columns of a quantity; standard ones are those of a phalanx if it has ``channels``."""
        standard = channel_names(quantity, channels) if channels else (quantity,)
        return self.columns.get(quantity, Columns(standard, (Decimal(1),) * len(standard)))

    def check(self, scene: Scene) -> None:
        """Require that the naming matches a scene.

        Raises
        ------
        ScanError
            It names a quantity that the scene does not have, or several columns for one value; a phalanx has
            the name of another quantity.
        """
        if taken := [name for name in scene.phalanx_names if name in _OTHERS]:
            raise ScanError(f"phalanx {taken[0]}: expected a name other than {', '.join(_OTHERS)}")
        unknown = {*AXIS_NAMES, *TRUE.values()} - {*scene.axis_names, *map(TRUE.get, scene.axis_names)}
        known = [name for name in (*_OTHERS, *scene.phalanx_names) if name not in unknown]
        for quantity, columns in self.columns.items():
            if quantity not in known:
                raise ScanError(
                    f"column naming {quantity!r}: expected one of {', '.join(known)}, strain_unit"
                )
            if quantity in {*_OTHERS} - {*STAMPS} and len(columns.names) > 1:
                raise ScanError(f"column naming {quantity!r}: expected 1 column, got {columns.given}")


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
    axes = scene.axis_names if scene else AXIS_NAMES
    counts = {each.name: each.channels for each in scene.phalanges} if scene else phalanges_in(header, naming)
    proposed = {} if counts else {name: json.dumps(each) for name, each in _groups(header, naming).items()}
    counts = counts or dict.fromkeys(proposed or ("finger",), DEFAULT_CHANNELS)
    hints = {"stamp_s": "time of the row, s; from ms: NAME * 0.001; of two: SEC + NANOSEC * 1e-9"}
    hints["pose_stamp_s"] = "the same in a file of --poses, if it has another name"
    hints |= dict.fromkeys(axes, "position of the palm, m (yaw: rad); from mm: NAME * 0.001")
    hints |= {name: f"{count} columns: NAME1..{count}, or [NAME, ...]" for name, count in counts.items()}
    hints |= dict.fromkeys(proposed, "a proposed phalanx, or leave it out")
    lines = [f"# columns found: {listed(header)}"]
    for name, hint in hints.items():
        if f"{name}_1" not in header:
            found = naming.columns[name].given if name in naming.columns else name * (name in header)
            lines.append(f"{name}: {proposed.get(name, found)}".ljust(24) + f"  # {hint}")
    example = f"{quantity}=NAME{'1..8' * (quantity not in _OTHERS)}"
    return MissingColumnError(
        f"{path}: expected a column for {quantity} ({', '.join(naming.of(quantity).names)}), found "
        f"{listed(header) or 'no header'}; fill in the naming above and pass it by --columns FILE, or pass "
        f"--column {example}",
        "\n".join(lines),
    )


def phalanges_in(header: Sequence[str], naming: ColumnNaming) -> dict[str, int]:
    """Number of channels of each phalanx that a naming or numbered columns ``<phalanx>_1``, ... give."""
    counts = {name: len(each.names) for name, each in naming.columns.items() if name not in _OTHERS}
    used, names = _used(naming), set(header)
    for column in header:
        phalanx, first = column[:-2], column.endswith("_1")
        if phalanx and first and column not in used and phalanx not in {*counts, *_OTHERS}:
            numbers = range(1, MOST_CHANNELS + 1)
            counts[phalanx] = next((n for n in numbers if f"{phalanx}_{n + 1}" not in names), MOST_CHANNELS)
    return counts


def _used(naming: ColumnNaming) -> set[str]:
    return {column for columns in naming.columns.values() for column in columns.names}


def _groups(header: Sequence[str], naming: ColumnNaming) -> dict[str, list[str]]:
    """Columns without a meaning by what they have in common before a number or a short ending."""
    groups: dict[str, list[str]] = {}
    for column in header:
        match = re.fullmatch(r"(.+?)(?:[\W_]*[0-9]+.*|[\W_]+[A-Za-z]{1,2})", column[:_LONGEST])
        if match and column not in {*_used(naming), *_OTHERS}:
            groups.setdefault(re.sub(r"\W+", "_", match[1]).strip("_") or "finger", []).append(column)
    return {name: columns for name, columns in groups.items() if len(columns) > 1}


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
    ParameterError
        It is not a mapping.
    ScanError
        An entry is neither a name nor a list of names.
    """
    entries = {str(name): value for name, value in mapping(content, "column naming").items()}
    unit = str(entries.pop("strain_unit", "V"))
    if not unit.isprintable():
        raise ScanError(f"strain_unit: expected printable text, got {unit!r:.80}")
    given = {name: value for name, value in entries.items() if value is not None}
    return ColumnNaming({name: _columns(name, value) for name, value in given.items()}, unit)


def naming_to_dict(naming: ColumnNaming) -> dict[str, Any]:
    """YAML form of a naming, which :func:`naming_from_dict` reads back."""
    columns = {quantity: columns.given for quantity, columns in naming.columns.items()}
    return columns | {"strain_unit": naming.strain_unit}


def naming_from_pairs(pairs: Sequence[str], base: ColumnNaming) -> ColumnNaming:
    """Override a naming with ``QUANTITY=COLUMNS`` arguments of the command line.

    Raises
    ------
    ScanError
        An argument has a different form.
    """
    content = naming_to_dict(base)
    for pair in pairs:
        quantity, equals, value = pair.partition("=")
        if not (quantity and equals and value):
            raise ScanError(f"column {pair!r}: expected QUANTITY=COLUMN, as in stamp_s=time_ms*0.001")
        content[quantity.strip()] = value
    return naming_from_dict(content)


def _columns(quantity: str, value: Any) -> Columns:
    """Columns of a list of names, or of a text with factors and, for a phalanx, commas."""
    where = f"column naming {quantity!r}"
    if not isinstance(value, str | list) or not value or not all(isinstance(each, str) for each in value):
        raise ScanError(f"{where}: expected a column's name or a list of names, got {value!r:.80}")
    offset = Decimal(0)
    if isinstance(value, list):
        terms = [[name] for name in value]
    elif quantity in STAMPS:
        text, *shift = _OFFSET.split(value)
        offset = _number(shift[0].replace(" ", ""), where) if shift else offset
        terms = [term.split("*", 1) for term in re.split(_SIGN + r"\+", text)]
    else:
        text, *factor = value.split("*", 1)
        terms = [[name, *factor] for name in ([text] if quantity in _OTHERS else text.split(","))]
    names: list[str] = []
    factors: list[Decimal] = []
    for name, *factor in terms:
        name = name.strip()
        match = _RANGE.fullmatch(name)
        first, last = (int(match[2]), int(match[3])) if match else (0, 0)
        if not 0 <= last - first < MOST_CHANNELS:
            raise ScanError(f"{where}: expected 1 to {MOST_CHANNELS} columns, got {name!r:.80}")
        found = [f"{match[1]}{index}" for index in range(first, last + 1)] if match else [name]
        names += found
        factors += [_number(factor[0], where) if factor else Decimal(1)] * len(found)
    return Columns(tuple(names), tuple(factors), offset, value)


def _number(text: str, where: str) -> Decimal:
    try:
        number = Decimal(text)
    except InvalidOperation:
        number = Decimal(0)
    if not number.is_finite() or not 0 < abs(number) <= LARGEST_NUMBER:
        raise ScanError(f"{where}: expected a number after *, + or -, other than 0, got {text!r:.80}")
    return number
