"""Naming of CSV columns: maps this package's quantities to column names, in YAML or on the command line.

The names are those of :mod:`tactile_localizer.io.names`, for example::

    stamp_s: timestamp * 0.001              # column * factor to the package's unit
    stamp_s: sec + nanosec * 1e-9 - 1.7e9   # stamps may be a sum, and have an offset, s
    stamp_s: row / 60                       # rows at 60 Hz, without a column of time
    x: position_mm * 0.001
    index: gauge1..8                        # a phalanx: one column per channel
    middle: ["Force 1, N", "Force 2, N"]    # names in a list are taken as they are
    thumb: column4..9                       # by number, from 1: of a file without a header
    strain_unit: counts                     # default: V

A position in the column of the stamps, as ``x: timestamp * 1e-5``, is a constant speed from the start of
each sweep on. Quantities without an entry have their standard names: ``stamp_s``, ``sweep``, the axis,
``index_1``, ``index_2``, .... ``pose_stamp_s`` names the stamps of a separate file of poses if they differ.
"""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tactile_localizer.channels import DEFAULT_CHANNELS
from tactile_localizer.errors import ScanError, listed
from tactile_localizer.io.csv.rows import NUMBER, Header
from tactile_localizer.io.names import ROW, Names, parse_names
from tactile_localizer.io.yaml_file import load_yaml, mapping
from tactile_localizer.scene import AXIS_NAMES, MOST_CHANNELS, Scene

FELT, SWEEP = "felt", "sweep"
TRUE = {axis: f"true_{axis}" for axis in AXIS_NAMES}
"""Quantities of the true position, by axis."""
STAMPS = ("stamp_s", "pose_stamp_s")
_OTHERS = (*STAMPS, SWEEP, FELT, *AXIS_NAMES, *TRUE.values())
"""Quantities that are no phalanges."""
_LONGEST = 100
"""Characters of a name that are compared with others for a proposal."""


@dataclass(frozen=True)
class ColumnNaming:
    """Columns with other than the standard names.

    Parameters
    ----------
    columns : columns by quantity: ``stamp_s``, ``sweep``, ``felt``, an axis, ``true_<axis>`` or a phalanx
    strain_unit : unit of the strain values, for display
    """

    columns: Mapping[str, Names] = field(default_factory=dict)
    strain_unit: str = "V"

    def of(self, quantity: str, channels: int = 0) -> Names:
        """Columns of a quantity; standard ones are those of a phalanx if it has ``channels``."""
        standard = channel_names(quantity, channels) if channels else (quantity,)
        return self.columns.get(quantity, Names.plain(standard))

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
    quantity : what has no column
    """

    def __init__(self, message: str, template: str = "", quantity: str = "") -> None:
        super().__init__(message)  # of which alone a worker process makes it again
        self.template, self.quantity = template, quantity


def missing_column(
    path: Path, quantity: str, naming: ColumnNaming, scene: Scene | None, files: Mapping[Path, Header]
) -> MissingColumnError:
    """Error about a quantity without a column, with a naming to fill in.

    Parameters
    ----------
    path : file that lacks it
    quantity : what has no column
    naming, scene : as far as they are known
    files : headers of the file of the strain, and of that of the poses if it is another one
    """
    header, (of_strain, *_) = files[path], files.values()
    counts = (
        {each.name: each.channels for each in scene.phalanges}
        if scene
        else phalanges_in(of_strain.names, naming)
    )
    wanted = naming.of(quantity, counts.get(quantity, 0)).names
    missing = [name for name in wanted if header.place(name) is None and name != ROW]
    is_part = 0 < len(missing) < len(wanted)
    named = f"{listed(missing)} of {len(wanted)} columns is missing" if is_part else listed(wanted)
    expected = f"expected a column for {quantity} ({named})"
    if header.first:
        example = "such as stamp_s: column1 + column2 * 1e-9, finger: column4..9"
        problem = f"{expected}, but the file has no header (line {header.line + 1} is numbers): name columns "
        problem += f"by number, {example}; pass --column '{quantity}=columnN'"
    else:
        several = "" if quantity in _OTHERS else f"1..{counts.get(quantity, DEFAULT_CHANNELS)}"
        rate = "; of rows at a constant rate, --column 'stamp_s=row / RATE'" * (quantity in STAMPS)
        found = listed(header.names) or "no header"
        problem = f"{expected}, found {found}; pass --column {quantity}=NAME{several}{rate}"
    return MissingColumnError(f"{path}: {problem}", _to_fill_in(naming, scene, counts, files), quantity)


def _to_fill_in(
    naming: ColumnNaming, scene: Scene | None, counts: Mapping[str, int], files: Mapping[Path, Header]
) -> str:
    """A naming in YAML for the columns of files, with what is known and proposed; arguments as above."""
    axes, (of_strain, *_) = scene.axis_names if scene else AXIS_NAMES, files.values()
    names = [name for header in files.values() for name in header.names]
    proposed = {} if counts else {name: json.dumps(each) for name, each in _groups(of_strain, naming).items()}
    counts = counts or dict.fromkeys(proposed or ("finger",), DEFAULT_CHANNELS)
    sec, nanosec, one, of_one = "SEC", "NANOSEC", "NAME", "NAME"
    if of_strain.first:
        sec, nanosec, one, of_one = "column1", "column2", "column4", "column"
    hints = {"stamp_s": f"time of the row, s; from ms: {one} * 0.001; of two: {sec} + {nanosec} * 1e-9; "}
    hints["stamp_s"] += "of rows at 60 Hz: row / 60"
    hints["pose_stamp_s"] = "the same in a file of --poses, if it has another name"
    hints[SWEEP] = "number or name of the sweep, if a file has several"
    hints |= dict.fromkeys(axes, f"position of the palm, m (yaw: rad); from mm: {one} * 0.001")
    hints |= {name: f"{count} columns: {of_one}1..{count}, or [NAME, ...]" for name, count in counts.items()}
    hints |= dict.fromkeys(proposed, "a proposed phalanx, or leave it out")
    lines = []
    for path, header in files.items():
        cells = zip(header.names, header.first, strict=False)
        found = [f"{name} ({cell.strip()[:20]})" for name, cell in cells] or header.names
        lines.append(f"# columns found{f' in {path}' * (len(files) > 1)}: {listed(found)}")
    for name, hint in hints.items():
        if f"{name}_1" not in names:
            given = naming.columns[name].given if name in naming.columns else name * (name in names)
            lines.append(f"{name}: {proposed.get(name, given)}".ljust(24) + f"  # {hint}")
    lines.append(
        f"strain_unit: {json.dumps(naming.strain_unit)}".ljust(24) + "  # of the values, for display"
    )
    return "\n".join(lines)


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


def _groups(header: Header, naming: ColumnNaming) -> dict[str, list[str]]:
    """Columns without a meaning by what they have in common before a number or a short ending."""
    groups: dict[str, list[str]] = {}
    for column in [] if header.first else header.names:
        match = re.fullmatch(r"(.+?)(?:[\W_]*[0-9]+.*|[\W_]+[A-Za-z]{1,2})", column[:_LONGEST])
        if match and not NUMBER.fullmatch(column) and column not in {*_used(naming), *_OTHERS}:
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
    unit = entries.pop("strain_unit", None)
    unit = "V" if unit is None else str(unit)
    if not unit.isprintable():
        raise ScanError(f"strain_unit: expected printable text, got {unit!r:.80}")
    given = {name: value for name, value in entries.items() if value is not None}
    columns = {
        name: parse_names(
            value,
            f"column naming {name!r}",
            several=name not in _OTHERS,
            is_sum=name in STAMPS,
            error=ScanError,
        )
        for name, value in given.items()
    }
    return ColumnNaming(columns, unit)


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
