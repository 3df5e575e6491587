"""Numbers of a CSV file: stamps, positions, strain and what else is known, of the rows that can be read."""

import math
import re
from array import array
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from datetime import datetime
from decimal import Decimal
from itertools import chain
from operator import mul
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tactile_localizer.errors import ScanError, listed
from tactile_localizer.io.csv.columns import (
    FELT,
    STAMPS,
    SWEEP,
    TRUE,
    ColumnNaming,
    Columns,
    missing_column,
    phalanges_in,
)
from tactile_localizer.io.csv.rows import Header, read_rows
from tactile_localizer.quantity import LARGEST_NUMBER
from tactile_localizer.scene import AXIS_NAMES, Scene

_MAX_STAMP_NS = 2**62
"""Largest stamp: differences of stamps fit into 64 bits."""
_DATE = re.compile(
    r"(?:([0-9/-]{10})[T ])?([0-9]{1,2}:[0-9]{2}:[0-9]{2})([.,][0-9]+)?\s*"
    r"(?:Z|UTC|([-+][0-9]{2}):?([0-9]{2})?)?"
)
"""Date in ISO 8601, time, fraction of a second, and hours and minutes of the time zone."""
_NO_DATE = "1970-01-01"
_FLAGS = {"true": "1", "false": "0"}
_MISSING = ("", "-", "na", "n/a", "#n/a", "<na>", "none", "null")
"""Spellings of a missing value beside NaN, in lower case."""


class Table(NamedTuple):
    """Numbers of a file, in SI units.

    Parameters
    ----------
    stamp_ns : (n,) stamps, ns
    position : (n, d) palm positions, finite; (n, 0) if none are wanted
    strain : (n, C) strain, NaN where missing; (n, 0) if none is wanted
    beside : (n,) values of each other quantity that the file has
    lost : number of rows that could not be read
    notes : one line for each kind of what could not be read
    """

    stamp_ns: np.ndarray
    position: np.ndarray
    strain: np.ndarray
    beside: Mapping[str, np.ndarray]
    lost: int
    notes: list[str]


def read_table(
    path: Path,
    scene: Scene,
    naming: ColumnNaming,
    stamp: str,
    axes: Mapping[str, Columns],
    strains: Mapping[str, Columns],
) -> Table:
    """Read a file.

    Parameters
    ----------
    path : the file
    scene, naming : name the columns
    stamp : quantity of the stamps
    axes, strains : columns of the positions and of the strain, of which one may be empty. Beside positions
        there may be true ones, beside strain the number of the sweep and whether a feature is felt

    Raises
    ------
    MissingColumnError
        A column is missing.
    ScanError
        The file cannot be read, has no valid row, or its stamps do not increase or are in another unit.
    """
    must = {stamp: naming.of(stamp), **axes, **strains}
    header, rows = read_rows(path, [name for each in must.values() for name in each.names])
    may = [*((SWEEP, FELT) if strains else ()), *(TRUE[axis] for axis in axes)]
    there = {*naming.columns, *header.names}
    beside = {name: naming.of(name) for name in may if not there.isdisjoint((name, *naming.of(name).names))}
    needed = {stamp: naming.of(stamp), **axes, **beside, **strains}
    required = len(axes) + (SWEEP in beside)
    cells = _Cells(header, needed, _indices(path, header.names, needed, naming, scene), required)
    stamps, values = array("q"), array("d")
    lost, first = 0, ""
    for line, row in rows:
        try:
            time_s, numbers = cells.read(row)
            if abs(time_s) * 10**9 > _MAX_STAMP_NS:
                unit = in_other_unit(stamp, needed[stamp])
                raise ValueError(f"expected a stamp in s, found {float(time_s):.6g}{unit}")
        except ValueError as error:
            if str(error):
                lost, first = lost + 1, first or f"line {line}, {error}"
            continue
        stamps.append(int((time_s * 10**9).to_integral_value()))
        values.extend(numbers)
    n, stamp_ns = len(stamps), np.array(stamps)
    if not n:
        problem = f" in {lost} rows ({first})" if lost else ""
        raise ScanError(f"{path}: expected rows of numbers, found none{problem}")
    if n > 1 and not np.ptp(stamp_ns):
        found = f"{stamp_ns[0] * 1e-9:.6g} s in all {n} rows"
        raise ScanError(f"{path}: expected stamps that increase, found {found}")
    notes = [f"skipped {lost} of {n + lost} rows of {path} (first: {first})"] * (lost > 0)
    notes += [f"{path}: sweeps in the order of the file: {listed(cells.sweeps)}"] * bool(cells.sweeps)
    table = np.frombuffer(values).reshape(n, -1)
    _convert(table, chain(*(each.factors for each in list(needed.values())[1:])))
    strain = table[:, len(axes) + len(beside) :]
    names = chain(*(each.names for each in strains.values()))
    counts = zip(names, np.isnan(strain).sum(axis=0).tolist(), strict=True)
    if missing := [f"{name} ({count} of {n} rows)" for name, count in counts if count]:
        notes.append(f"{path}: no number in {listed(missing)}")
    return Table(
        stamp_ns,
        table[:, : len(axes)],
        strain,
        dict(zip(beside, table[:, len(axes) :].T, strict=False)),
        lost,
        notes,
    )


def _convert(table: np.ndarray, factors: Iterable[Decimal]) -> None:
    """Multiply the columns of a table (n, m) by ``factors``, in place; too large values are missing."""
    for column, factor in zip(table.T, factors, strict=True):  # a large table has no copy
        with np.errstate(over="ignore", invalid="ignore"):
            column *= float(factor)
        column[~(np.abs(column) <= LARGEST_NUMBER)] = math.nan


class _Cells:
    """Conversion of the wanted cells of a row: the stamp, s, and the other values in the units of the file.

    Parameters
    ----------
    header : header of the file
    needed : columns by quantity: the stamp, ``required`` ones that have to be finite, and others
    indices : places of all these columns in the header

    Attributes
    ----------
    sweeps : numbers of the sweeps by their names, where the first of them is no number
    """

    def __init__(
        self, header: Header, needed: Mapping[str, Columns], indices: Sequence[int], required: int
    ) -> None:
        self._header, self._indices = header, indices
        self._stamp = next(iter(needed.values()))
        self._stamps = len(self._stamp.names)
        self._required = self._stamps + required
        self._quantities = [name for name, each in needed.items() for _ in each.names]
        self._are_numbered = SWEEP not in needed
        self.sweeps: dict[str, int] = {}

    def read(self, row: list[str]) -> tuple[Decimal, list[float]]:
        """Read a row.

        Raises
        ------
        ValueError
            It cannot be read; without a reason, if it has none of the values and belongs to another series.
        """
        if not self.sweeps:
            with suppress(ValueError, ArithmeticError, IndexError):
                read = self._numbers([row[each] for each in self._indices])
                self._are_numbered = True
                return read
        names = self._header.names
        if len(row) <= max(self._indices):
            raise ValueError(f"expected {len(names)} cells, found {len(row)}")
        cells = [row[each].strip() for each in self._indices]
        if not any(cells[self._stamps :]):
            raise ValueError
        commas = self._header.separator != "," and "." not in "".join(cells)
        plain = [
            _plain(quantity, cell.replace(",", ".") if commas else cell)
            for quantity, cell in zip(self._quantities, cells, strict=True)
        ]
        named = self._named_sweep(cells, plain)
        for place, text in enumerate(plain):
            if place != named and not _is_number(text, required=place < self._required):
                found = repr(cells[place][:40]) if cells[place] else "an empty cell"
                if not cells[place] and self._stamps <= place < self._required:
                    found += " (positions in rows of their own? pass the file by --poses too)"
                if "," in cells[place]:
                    found += " (a decimal comma? write points, or separate by semicolons)"
                if ":" in cells[place] and self._quantities[place] in STAMPS:
                    found += " (a date? write it like 2024-11-25 16:00:01.5)"
                raise ValueError(f"column {names[self._indices[place]]}: expected a number, found {found}")
        self._are_numbered = named is None
        if named is not None:
            plain[named] = str(self.sweeps.setdefault(cells[named], len(self.sweeps) + 1))
        return self._numbers(plain)

    def _named_sweep(self, cells: Sequence[str], plain: Sequence[str]) -> int | None:
        """Place of the sweep's name in a row; ``None`` if it has a number, or is in the column of numbers."""
        if self._are_numbered:
            return None
        place = self._quantities.index(SWEEP)
        is_number = not self.sweeps and _is_number(plain[place], required=True)
        return None if is_number or cells[place].lower() in (*_MISSING, "nan") else place

    def _numbers(self, cells: Sequence[str]) -> tuple[Decimal, list[float]]:
        """Raises the exceptions of ``float`` and ``Decimal``, which take underscores and other digits too."""
        if not (joined := "".join(cells)).isascii() or "_" in joined:
            raise ValueError
        # A float would lose 0.2 us since 1970.
        time_s = sum(map(mul, map(Decimal, cells[: self._stamps]), self._stamp.factors), self._stamp.offset)
        numbers = list(map(float, cells[self._stamps :]))
        if not time_s.is_finite() or not all(
            abs(each) <= LARGEST_NUMBER for each in numbers[: self._required - self._stamps]
        ):
            raise ValueError
        return time_s, numbers


def _plain(quantity: str, cell: str) -> str:
    """A cell as a number: of a date or time in UTC, 1 for true, NaN for an empty cell that is not needed."""
    if quantity in STAMPS and (date := _DATE.fullmatch(cell)):
        with suppress(ValueError):
            day, time, fraction, hours, minutes = date.groups(default="")
            zone = f"{hours or '+00'}:{minutes or '00'}"
            text = f"{(day or _NO_DATE).replace('/', '-')} {time:0>8}{zone}"
            second = datetime.fromisoformat(text).timestamp()
            return str(Decimal(second) + Decimal(fraction.replace(",", ".") or 0))
    if quantity == FELT:
        cell = _FLAGS.get(cell.lower(), cell)
    return "nan" if cell.lower() in _MISSING and quantity not in (SWEEP, *AXIS_NAMES) else cell


def _is_number(text: str, *, required: bool) -> bool:
    try:
        return text.isascii() and "_" not in text and (abs(float(text)) <= LARGEST_NUMBER or not required)
    except ValueError:
        return False


def _indices(
    path: Path, header: Sequence[str], needed: Mapping[str, Columns], naming: ColumnNaming, scene: Scene
) -> list[int]:
    """Places of the columns in the header, each of which there is once, and of each phalanx all."""
    channels = {phalanx.name: phalanx.channels for phalanx in scene.phalanges}
    for name, found in phalanges_in(header, naming).items():
        if name in needed and found != channels[name]:
            raise ScanError(
                f"{path}: expected {channels[name]} channels for phalanx {name} as in the scene, found "
                f"{found} columns; write channels: {found} below {name} in the scene"
            )
    for quantity, columns in needed.items():
        for name in columns.names:
            if name not in header:
                raise missing_column(path, header, quantity, naming, scene)
            if header.count(name) > 1:
                raise ScanError(f"{path}: expected one column {name!r}, found {header.count(name)}")
    return [header.index(name) for columns in needed.values() for name in columns.names]


def in_other_unit(quantity: str, column: Columns) -> str:
    """Advice on stamps that seem to be in another unit."""
    name = f"--column {quantity}={column.names[0]}"
    return f" (another unit? {name}*0.001 for ms, *1e-6 for us, *1e-9 for ns)"
