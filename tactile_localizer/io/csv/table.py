"""Numbers of a CSV file: stamps, positions, strain and what else is known, of the rows that can be read."""

import math
import re
import warnings
from array import array
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from datetime import datetime
from decimal import Decimal
from io import StringIO
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
    missing_column,
    phalanges_in,
)
from tactile_localizer.io.csv.rows import MISSING, NUMBER, Block, Header, cells_of, read_rows
from tactile_localizer.io.names import ROW, Names
from tactile_localizer.quantity import LARGEST_NUMBER
from tactile_localizer.scene import AXIS_NAMES, Scene

_NS = 10**9
_MAX_STAMP_NS = 2**62
"""Largest stamp: differences of stamps fit into 64 bits."""
_DATE = re.compile(
    r"(?:([0-9/-]{10})[T ])?([0-9]{1,2}:[0-9]{2}:[0-9]{2})([.,][0-9]+)?\s*"
    r"(?:Z|UTC|([-+][0-9]{2}):?([0-9]{2})?)?"
)
"""Date in ISO 8601, time, fraction of a second, and hours and minutes of the time zone."""
_NO_DATE = "1970-01-01"
_FLAGS = {"true": "1", "false": "0"}
_LEADING_ZERO = re.compile(r"\.0[0-9]")
_SUBUNITS = {3: "MILLISEC", 6: "MICROSEC", 9: "NANOSEC"}
"""Parts of a second by their digits."""


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
    axes: Mapping[str, Names],
    strains: Mapping[str, Names],
    other: Path | None = None,
) -> Table:
    """Read a file.

    Parameters
    ----------
    path : the file
    scene, naming : name the columns
    stamp : quantity of the stamps
    axes, strains : columns of the positions and of the strain, of which one may be empty. Beside positions
        there may be true ones, beside strain the number of the sweep and whether a feature is felt
    other : the file of the poses beside that of the strain, or the reverse

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

    def without(quantity: str) -> ScanError:
        return missing_column(
            path, quantity, naming, scene, _headers(path, header, other, naming, bool(strains))
        )

    places = _places(path, header, needed, naming, scene, without)
    cells = _Cells(path, header, needed, places, required)
    for block in rows:
        cells.read(block)
    stamp_ns, table = np.array(cells.stamp_ns), np.frombuffer(cells.values)
    lost = cells.lost
    n = len(stamp_ns)
    if not n:
        problem = f" in {lost} rows ({cells.first})" if lost else ""
        raise ScanError(f"{path}: expected rows of numbers, found none{problem}")
    notes = [f"skipped {lost} of {n + lost} rows of {path} (first: {cells.first})"] * (lost > 0)
    if cells.empty and other not in (None, path):  # else these are rows of other series
        found = f"{cells.empty} of {n + lost + cells.empty} rows of {path} have no value"
        notes.append(f"{found} (first: {cells.first_empty})")
    if padded := cells.in_whole_seconds(stamp_ns):
        stamp_ns, note = padded
        notes.append(f"{path}: {note}")
    if n > 1 and not np.ptp(stamp_ns):
        constant = f"{stamp_ns[0] * 1e-9:.6g} s in all {n} rows"
        raise ScanError(f"{path}: expected stamps that increase, found {constant}")
    notes += [f"{path}: sweeps in the order of the file: {listed(cells.sweeps)}"] * bool(cells.sweeps)
    table = table.reshape(n, -1)
    strain = table[:, len(axes) + len(beside) :]
    names = chain(*(each.names for each in strains.values()))
    counts = zip(names, np.isnan(strain).sum(axis=0).tolist(), strict=True)
    missing = {name: count for name, count in counts if count}
    if never := [name for name in missing if missing[name] == n]:
        notes.append(f"{path}: no number in any row of {listed(never)}: leave it out of the naming")
    if some := [f"{name} ({count} of {n} rows)" for name, count in missing.items() if count < n]:
        notes.append(f"{path}: no number in {listed(some)}")
    return Table(
        stamp_ns,
        table[:, : len(axes)],
        strain,
        dict(zip(beside, table[:, len(axes) :].T, strict=False)),
        lost,
        notes,
    )


class _Cells:
    """Conversion of the wanted cells of a file to its stamps and other values.

    Lines that are all rows of numbers are read at once. Of others, as with a date or a missing value, the
    cells are written as plain numbers first; a row without is left out.

    Parameters
    ----------
    path, header : of the file
    needed : columns by quantity: the stamp, ``required`` ones that have to be finite, and others
    places : of all these columns in a row, from 1, 0 for the row's own number

    Attributes
    ----------
    stamp_ns : n stamps, ns
    values : n rows of other values; NaN where missing or too large
    lost, first : number of rows that could not be read, and what is wrong with the first
    empty, first_empty : number of rows with a stamp alone, and the place of the first
    sweeps : numbers of the sweeps by their names, where the first of them is no number
    """

    def __init__(
        self, path: Path, header: Header, needed: Mapping[str, Names], places: Sequence[int], required: int
    ) -> None:
        self._path, self._header, self._places = path, header, places
        self._words = {name for name in header.names if name and not NUMBER.fullmatch(name)}
        self._rows = 0
        stamp, self._stamp = next(iter(needed.items()))
        self._unit = in_other_unit(stamp, self._stamp)
        self._stamps = len(self._stamp.names)
        self._required = required
        self._quantities = [name for name, each in needed.items() for _ in each.names]
        factors = [factor for each in needed.values() for factor in each.factors]
        self._factors = np.array(factors[self._stamps :], float)
        self._are_numbered = SWEEP not in needed
        self._texts: dict[int, str] | None = {} if self._stamps == 1 else None
        self.stamp_ns, self.values = array("q"), array("d")  # a large recording is held once
        self.lost, self.first, self.empty, self.first_empty = 0, "", 0, ""
        self.sweeps: dict[str, int] = {}

    def read(self, block: Block) -> None:
        """Read lines.

        Raises
        ------
        ScanError
            A row has more cells than the header.
        """
        try:
            if self.sweeps or 0 in self._places or block.has_comments:
                raise ValueError  # a name may look like a number
            separator = None if self._header.separator == " " else self._header.separator
            places = [place - 1 for place in self._places]
            self._add(block.text, block.lines, separator, places, len(self._header.names))
        except ValueError:
            rows = {line: self._plain(line, text) for line, text in block.rows().items()}
            plain = {line: ",".join(cells) for line, cells in rows.items() if cells}
            width = len(self._places)
            self._add("\n".join(plain.values()), list(plain), ",", range(width), width)

    def in_whole_seconds(self, stamp_ns: np.ndarray) -> tuple[np.ndarray, str] | None:
        """Stamps of ``SEC.NANOSEC`` without leading zeros, ns, and a note; ``None`` if they are decimals.

        Such fractions differ in length, have no leading zero, and as decimals they go back within a second.
        """
        if not self._texts or (at := _first_back(stamp_ns)) is None:
            return None
        parts = [text.partition(".")[::2] for text in self._texts.values()]
        longest = max(len(fraction) for _, fraction in parts)
        if longest > max(_SUBUNITS):
            return None
        digits = next(each for each in _SUBUNITS if each >= longest)
        padded = [f"{second}.{fraction:0>{digits}}" for second, fraction in parts]
        stamp_ns = self._times([padded]).astype(np.int64)
        if _first_back(stamp_ns) is not None:
            return None
        line, text = list(self._texts.items())[at - 1]
        found = f"stamps look like SEC.{_SUBUNITS[digits]} without leading zeros (line {line}: {text}"
        return stamp_ns, f"{found} is read as {padded[at - 1]})"

    def _add(
        self, text: str, lines: Sequence[int], separator: str | None, places: Sequence[int], width: int
    ) -> None:
        """Add the rows of numbers in a text, one from each of ``lines``, of ``width`` cells.

        Raises
        ------
        ValueError
            A row has other cells, or another number of them.
        """
        if not lines:
            return
        kinds = {**dict.fromkeys(places, "f8"), **dict.fromkeys(places[: self._stamps], "O")}
        kind = np.dtype([(f"{place}", kinds.get(place, "U1")) for place in range(width)])
        found = np.loadtxt(
            StringIO(text), kind, comments=None, delimiter=separator, ndmin=1, quotechar='"', encoding=None
        )
        texts = [list(map(str.strip, found[f"{place}"])) for place in places[: self._stamps]]
        stamp_ns = self._times(texts)
        columns = [found[f"{place}"] for place in places[self._stamps :]]
        values = np.column_stack(columns).astype(float, copy=False)
        is_valid = abs(stamp_ns) <= _MAX_STAMP_NS, abs(values[:, : self._required]) <= LARGEST_NUMBER
        if len(values) != len(lines) or not all(map(np.all, is_valid)):
            raise ValueError
        self._are_numbered = not self.sweeps
        with np.errstate(over="ignore", invalid="ignore"):
            values *= self._factors
        if (missing := ~(abs(values) <= LARGEST_NUMBER)).any():
            values[missing] = math.nan
        self.stamp_ns.frombytes(stamp_ns.astype(np.int64).data.cast("B"))
        self.values.frombytes(values.data.cast("B"))
        if self._texts is not None:
            self._texts |= dict(zip(lines, texts[0], strict=True))
            self._texts = None if _LEADING_ZERO.search(" ".join(texts[0])) else self._texts

    def _times(self, columns: Sequence[Sequence[str]]) -> np.ndarray:
        """Stamps (n,), whole ns, of the cells of their columns; a double would lose 0.2 us since 1970."""
        total = np.full(len(columns[0]), np.longdouble(str(_NS * self._stamp.offset)))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # of too large numbers, which are refused
            for cells, factor in zip(columns, self._stamp.factors, strict=True):
                seconds = np.array(cells, object).astype(np.longdouble)
                total = total + seconds * np.longdouble(str(_NS * factor))
        return np.rint(total)

    def _plain(self, line: int, text: str) -> list[str]:
        """The wanted cells of a row as plain numbers; empty if it is of another series, or cannot be read."""
        try:
            return self._as_numbers(line, cells_of(text, self._header.separator))
        except ValueError as error:
            if str(error):
                self.lost, self.first = self.lost + 1, self.first or f"line {line}, {error}"
            return []

    def _as_numbers(self, line: int, row: Sequence[str]) -> list[str]:
        """Raises why a row cannot be read; without a reason, if it has none of the values, but the names."""
        cells = self._wanted(line, row)
        if not any(cells[self._stamps :]):
            if any(cells[: self._stamps]):
                column = self._header.names[self._places[self._stamps] - 1]
                first = f"line {line}, column {column}: expected a number, found an empty cell"
                self.empty, self.first_empty = self.empty + 1, self.first_empty or first
            raise ValueError
        commas = self._header.separator != "," and "." not in "".join(cells)
        plain = [
            _plain(quantity, cell.replace(",", ".") if commas else cell)
            for quantity, cell in zip(self._quantities, cells, strict=True)
        ]
        named, end = self._named_sweep(cells, plain), self._stamps + self._required
        for place, text in enumerate(plain):
            if place != named and not _is_number(text, required=place < end):
                found = repr(cells[place][:40]) if cells[place] else "an empty cell"
                if not cells[place] and self._stamps <= place < end:
                    found += " (positions in rows of their own? pass the file by --poses too)"
                if "," in cells[place]:
                    found += " (a decimal comma? write points, or separate by semicolons)"
                if ":" in cells[place] and self._quantities[place] in STAMPS:
                    found += " (a date? write it like 2024-11-25 16:00:01.5)"
                name = self._header.names[self._places[place] - 1]
                raise ValueError(f"column {name}: expected a number, found {found}")
        stamp = map(mul, map(Decimal, plain), self._stamp.factors)
        if abs(time_s := sum(stamp, self._stamp.offset)) * _NS > _MAX_STAMP_NS:
            raise ValueError(f"expected a stamp in s, found {float(time_s):.6g}{self._unit}")
        self._are_numbered = named is None
        if named is not None:
            plain[named] = str(self.sweeps.setdefault(cells[named], len(self.sweeps) + 1))
        return plain

    def _wanted(self, line: int, row: Sequence[str]) -> list[str]:
        """The wanted cells of a row, or why it has none; without a reason, if it repeats the header."""
        names, row = self._header.names, [cell.strip() for cell in row]
        if row == names:
            raise ValueError
        if len(self._words.intersection(row)) > 1:
            found = "other files behind each other? split them"
            raise ScanError(f"{self._path} line {line}: expected numbers, found another header ({found})")
        self._rows += 1
        if any(row[len(names) :]):
            raise ScanError(
                f"{self._path} line {line}: expected {len(names)} cells as in the header, found {len(row)} "
                "(decimal commas? write points, or separate by semicolons)"
            )
        if len(row) < max(self._places):
            raise ValueError(f"expected {len(names)} cells, found {len(row)}")
        return [row[place - 1] if place else str(self._rows - 1) for place in self._places]

    def _named_sweep(self, cells: Sequence[str], plain: Sequence[str]) -> int | None:
        """Place of the sweep's name in a row; ``None`` if it has a number, or is in the column of numbers."""
        if self._are_numbered:
            return None
        place = self._quantities.index(SWEEP)
        is_number = not self.sweeps and _is_number(plain[place], required=True)
        return None if is_number or cells[place].lower() in MISSING else place


def _first_back(stamp_ns: np.ndarray) -> int | None:
    """The first of stamps that is before the last one and in the same second; ``None`` without."""
    is_back = (np.diff(stamp_ns) < 0) & (np.diff(stamp_ns // _NS) == 0)
    return int(np.argmax(is_back)) + 1 if is_back.any() else None


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
    return "nan" if cell.lower() in MISSING and quantity not in (SWEEP, *AXIS_NAMES) else cell


def _is_number(text: str, *, required: bool) -> bool:
    try:
        return text.isascii() and "_" not in text and (abs(float(text)) <= LARGEST_NUMBER or not required)
    except ValueError:
        return False


def _places(
    path: Path,
    header: Header,
    needed: Mapping[str, Names],
    naming: ColumnNaming,
    scene: Scene,
    missing: Callable[[str], ScanError],
) -> list[int]:
    """Places of the columns in a row, from 1, each of which there is once, and of each phalanx all.

    0 is that of the row's own number. ``missing`` makes the error about a quantity without one.
    """
    channels = {phalanx.name: phalanx.channels for phalanx in scene.phalanges}
    for name, found in phalanges_in(header.names, naming).items():
        if name in needed and found != channels[name]:
            raise ScanError(
                f"{path}: expected {channels[name]} channels for phalanx {name} as in the scene, found "
                f"{found} columns; write channels: {found} below {name} in the scene"
            )
    places = []
    for quantity, columns in needed.items():
        for name in columns.names:
            place = header.place(name)
            if place is None and name != ROW:
                raise missing(quantity)
            if (same := header.names.count(name)) > 1:
                raise ScanError(
                    f"{path}: expected one column {name!r}, found {same}; name it by its number, from 1: "
                    f"column{header.names.index(name) + 1}"
                )
            places.append(0 if place is None else place + 1)
    return places


def _headers(
    path: Path, header: Header, other: Path | None, naming: ColumnNaming, is_strain: bool
) -> dict[Path, Header]:
    """Headers of a file and of the other one of the recording, that of the strain first."""
    files = {path: header}
    if other not in (None, path):
        known = (*STAMPS, *AXIS_NAMES, *(name for each in naming.columns.values() for name in each.names))
        with suppress(ScanError):  # what is wrong with it is said when it is read
            files[other] = read_rows(other, known)[0]
    return files if is_strain else dict(reversed(files.items()))


def in_other_unit(quantity: str, column: Names) -> str:
    """Advice on stamps that seem to be in another unit."""
    name = f"--column {quantity}={column.names[0]}"
    return f" (another unit? {name}*0.001 for ms, *1e-6 for us, *1e-9 for ns)"
