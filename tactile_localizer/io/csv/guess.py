"""Guess of the meaning of CSV columns, from their names and the scene.

Only quantities that are neither given nor have their standard names are guessed: time stamps and their
unit, the sweep number, positions, a constant speed, and the channels of each phalanx (numbered columns, or
the forces and torques of a wrench).
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from functools import cached_property
from itertools import islice
from pathlib import Path

import numpy as np

from tactile_localizer.errors import ScanError
from tactile_localizer.io.csv.columns import (
    ANGLES,
    LENGTHS,
    TIMES,
    ColumnNaming,
    Columns,
    channel_names,
    fitting_unit,
)
from tactile_localizer.io.csv.table import listed, read_table
from tactile_localizer.scene import MOST_CHANNELS, Axis, Phalanx, Scene

_SAMPLE_ROWS = 2000
"""Rows from which units are guessed; several seconds of samples at common rates."""

_MAX_COLUMNS = 5000
"""Most columns considered, which bounds time and memory for absurd files."""

_UNITS = {
    "s": 1.0, "sec": 1.0, "seconds": 1.0, **TIMES, "µs": 1e-6,
    "m": 1.0, **LENGTHS, "in": 0.0254, "inch": 0.0254,
    "rad": 1.0, "deg": ANGLES["degrees"], **ANGLES,
    "mps": 1.0, "mmps": 0.001, "m/s": 1.0, "mm/s": 0.001,
    "v": 1.0, "mv": 0.001, "uv": 1e-6, "µv": 1e-6,
}  # fmt: skip
"""Size in SI units of the units that end a column's name."""

_STAMP = ("stamp", "timestamp", "time", "t", "elapsed", "seconds", "clock")
_SWEEP = ("sweep", "run", "trial", "repeat", "stroke", "pass")
_SPEED = ("speed", "velocity", "vel", "v")

_SAMPLING_PERIODS_S = (5e-5, 0.2)
"""Plausible sampling periods of a tactile sensor, s: 20 kHz to 5 Hz (judgement)."""

_CONSTANT_SPEED_VARIATION = 0.02
"""Largest coefficient of variation of a speed that counts as constant (judgement)."""

_WRENCH = re.compile(r"^(.*?)[._ ]?(f|t|m|force[._]?|torque[._]?)([xyz])$")
_NUMBERED = re.compile(r"^(.*?)([0-9]{1,4})$")


@dataclass
class Guess:
    """Guessed meaning of a file's columns.

    Parameters
    ----------
    naming : given and guessed columns
    guessed : reason for each guess, by quantity
    missing : for each quantity without columns, what the user has to add
    """

    naming: ColumnNaming
    guessed: dict[str, str] = field(default_factory=dict)
    missing: list[str] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class _Column:
    """A column: its name, the name in lower case without unit, the factor of its unit, its cells."""

    name: str
    plain: str
    factor: float | None
    rows: Sequence[Sequence[str]]
    index: int

    @cached_property
    def values(self) -> np.ndarray:
        """Numbers in the first rows, NaN for other cells; converted only for the columns that need it."""
        return _numbers(self.rows, self.index)


def guess_columns(path: str | Path, scene: Scene, naming: ColumnNaming) -> Guess:
    """Guess the columns of the quantities without an entry in a naming.

    Parameters
    ----------
    path : the file, of which the header and the first rows are read
    scene : axes and phalanges to find
    naming : columns that are known

    Raises
    ------
    ScanError
        The file cannot be read, or a quantity is neither given nor found.
    """
    path = Path(path)
    columns, header = _columns_of(path)
    guess = Guess(naming)
    known = {name for columns_of in naming.columns.values() for name in columns_of.names}
    free = [column for column in columns if column.name not in known]
    names = set(header)
    if "stamp_s" not in naming.columns and "stamp_s" not in names:
        _guess_stamp(guess, free)
    if "sweep" not in naming.columns and "sweep" not in names:
        _guess_sweep(guess, free)
    for axis in scene.axes:
        if axis.name not in {*naming.columns, *guess.naming.speed, *names}:
            _guess_axis(guess, axis, scene, free)
    used = {name for columns_of in guess.naming.columns.values() for name in columns_of.names}
    groups = _groups([column for column in free if column.name not in used])
    open_phalanges = [
        phalanx
        for phalanx in scene.phalanges
        if phalanx.name not in naming.columns
        and not names.issuperset(channel_names(phalanx.name, phalanx.channels))
    ]
    _guess_phalanges(guess, open_phalanges, groups)
    if guess.missing:
        found = listed(header) or "no header"
        raise ScanError(f"{path}: expected {'; '.join(guess.missing)}; found {found}")
    return guess


def _columns_of(path: Path) -> tuple[list[_Column], list[str]]:
    table = read_table(path)
    _, header = next(table, (0, []))
    header = [name.strip() for name in header]
    rows = [cells for _, cells in islice(table, _SAMPLE_ROWS if len(header) <= _MAX_COLUMNS else 2)]
    columns = []
    for index, name in enumerate(header[:_MAX_COLUMNS]):
        plain, factor = _split_unit(name)
        columns.append(_Column(name, plain, factor, rows, index))
    return columns, header


def _numbers(rows: Sequence[Sequence[str]], index: int) -> np.ndarray:
    values = np.full(len(rows), np.nan)
    for number, row in enumerate(rows):
        try:
            values[number] = float(row[index])
        except (ValueError, IndexError):
            continue
    return values


def _split_unit(name: str) -> tuple[str, float | None]:
    """A name in lower case without its unit, and the unit's factor; ``None`` without a unit."""
    text = name.lower()
    for pattern in (r"^(.+?)[\s_]*[\[(]\s*(.+?)\s*[\])]$", r"^(.+)[_\s]([a-zµ/]+)$"):
        match = re.match(pattern, text)
        if match and match.group(2) in _UNITS:
            return match.group(1), _UNITS[match.group(2)]
    return text, None


def _assign(guess: Guess, quantity: str, names: Iterable[str], factor: float, why: str) -> None:
    columns = Columns(tuple(names), Decimal(f"{factor:.10g}"))
    guess.naming = replace(guess.naming, columns={**guess.naming.columns, quantity: columns})
    guess.guessed[quantity] = why


def _guess_stamp(guess: Guess, columns: Sequence[_Column]) -> None:
    for word in _STAMP:
        for column in columns:
            last = re.split(r"[._ ]", column.plain)[-1]
            if word in (column.plain, last):
                factor = column.factor if column.factor is not None else _time_unit(column.values)
                if factor is not None:
                    why = "unit in its name" if column.factor is not None else "unit from the sampling period"
                    return _assign(guess, "stamp_s", [column.name], factor, why)
    guess.missing.append("time stamps (--column stamp_s=NAME, with NAME*0.001 for ms)")
    return None


def _time_unit(values: np.ndarray) -> float | None:
    """Unit of stamps (n,) that gives a plausible sampling period, s; ``None`` if there is none."""
    values = values[np.isfinite(values)]
    if len(values) < 2:
        return None
    steps = np.abs(np.diff(values))
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    return next(
        (
            factor
            for factor in (1.0, *TIMES.values())
            if _SAMPLING_PERIODS_S[0] <= step * factor <= _SAMPLING_PERIODS_S[1]
        ),
        None,
    )


def _guess_sweep(guess: Guess, columns: Sequence[_Column]) -> None:
    for column in columns:
        words = re.split(r"[._ ]", column.plain)
        whole = np.isfinite(column.values).all() and (column.values == np.rint(column.values)).all()
        if words[0] in _SWEEP and whole and len(column.values):
            return _assign(guess, "sweep", [column.name], 1.0, "name")
    return None


def _guess_axis(guess: Guess, axis: Axis, scene: Scene, columns: Sequence[_Column]) -> None:
    alone = scene.dimension == 1
    for column in columns:
        if _is_position(column.plain, axis.name, alone):
            factor, why = column.factor, "unit in its name"
            if factor is None:
                factor, why = _length_unit(axis, column.values)
            return _assign(guess, axis.name, [column.name], factor, why)
    for column in columns if alone else ():
        values = column.values[np.isfinite(column.values)]
        mean = float(values.mean()) if len(values) else 0.0
        constant = mean != 0.0 and values.std() <= _CONSTANT_SPEED_VARIATION * abs(mean)
        if constant and re.split(r"[._ ]", column.plain)[0] in _SPEED:
            speeds = {**guess.naming.speed, axis.name: float(f"{mean * (column.factor or 1.0):.6g}")}
            guess.naming = replace(guess.naming, speed=speeds)
            guess.guessed[axis.name] = f"constant speed in {column.name}"
            return None
    speed = "M_PER_S" if alone else f"{axis.name}=M_PER_S"
    guess.missing.append(
        f"a position on {axis.name} (--column {axis.name}=NAME, with NAME*0.001 for mm; or --speed {speed} "
        "if the hand moved at constant speed)"
    )
    return None


def _is_position(plain: str, axis: str, alone: bool) -> bool:
    words = [word for word in re.split(r"[._ \-]", plain) if word]
    synonyms = {
        "x": {"x", "px"},
        "y": {"y", "py"},
        "yaw": {"yaw", "heading", "theta", "rz", "angle"},
    }[axis]
    places = {"pos", "position", "palm", "tcp", "ee", "pose", "hand", "rot", "orientation", "tool"}
    if synonyms & set(words) and set(words) <= synonyms | places:
        return True
    general = {"pos", "position", "displacement", "distance", "travel"}
    return alone and axis != "yaw" and bool(words) and set(words) <= general | {"palm", "hand"}


def _length_unit(axis: Axis, values: np.ndarray) -> tuple[float, str]:
    """Factor for positions without a stated unit: 1 if they fit the bounds, else that of a fitting unit."""
    found = fitting_unit(axis, values, ANGLES if axis.name == "yaw" else LENGTHS)
    return (found[1], f"fits the bounds in {found[0]}") if found else (1.0, "name")


def _groups(columns: Sequence[_Column]) -> dict[str, list[_Column]]:
    """Groups of numbered columns and of wrench components, by the common part of their names."""
    numbered: dict[str, dict[int, _Column]] = defaultdict(dict)
    wrenches: dict[str, dict[str, _Column]] = defaultdict(dict)
    for column in columns:
        if match := _NUMBERED.match(column.plain):
            numbered[match.group(1)][int(match.group(2))] = column
        elif match := _WRENCH.match(column.plain):
            kind = "f" if match.group(2)[0] == "f" else "t"
            wrenches[re.sub(r"[._ ]?wrench$", "", match.group(1))][kind + match.group(3)] = column
    groups = {}
    for prefix, by_number in numbered.items():
        first = min(by_number)
        if first in (0, 1) and len(by_number) > 1 and max(by_number) == first + len(by_number) - 1:
            groups[prefix] = [by_number[number] for number in sorted(by_number)]
    for prefix, by_axis in wrenches.items():
        if {"fx", "fy", "fz"} <= set(by_axis):
            order = [key for key in ("fx", "fy", "fz", "tx", "ty", "tz") if key in by_axis]
            groups[prefix] = [by_axis[key] for key in order]
    return groups


def _guess_phalanges(guess: Guess, phalanges: Sequence[Phalanx], groups: dict[str, list[_Column]]) -> None:
    left = dict(groups)
    unnamed = []
    for phalanx in phalanges:
        own = [prefix for prefix in left if phalanx.name.lower() in prefix]
        if len(own) == 1 and len(left[own[0]]) == phalanx.channels:
            _assign_group(guess, phalanx, left.pop(own[0]), "name")
        else:
            unnamed.append(phalanx)
    if len(unnamed) == 1:
        fitting = [prefix for prefix, group in left.items() if len(group) == unnamed[0].channels]
        if len(fitting) == 1:
            return _assign_group(guess, unnamed[0], left[fitting[0]], f"{unnamed[0].channels} of one name")
    total = sum(phalanx.channels for phalanx in unnamed)
    together = [group for group in left.values() if len(group) == total]
    if len(unnamed) > 1 and len(together) == 1:
        for phalanx, end in zip(unnamed, np.cumsum([each.channels for each in unnamed]), strict=True):
            part = together[0][end - phalanx.channels : end]
            _assign_group(guess, phalanx, part, f"its part of {total}, in the scene's order")
        return None
    for phalanx in unnamed:
        n = phalanx.channels
        hint = f"columns of phalanx {phalanx.name} with {n} channels (--column {phalanx.name}=NAME1..{n}"
        other = next((g for p, g in left.items() if phalanx.name.lower() in p or len(left) == 1), None)
        if other is not None and len(other) != n and len(other) <= MOST_CHANNELS:
            hint += (
                f"; for the {len(other)} columns {other[0].name} to {other[-1].name} write channels: "
                f"{len(other)} below {phalanx.name} in the scene"
            )
        guess.missing.append(hint + ")")
    return None


def _assign_group(guess: Guess, phalanx: Phalanx, group: Sequence[_Column], why: str) -> None:
    factors = {column.factor for column in group}
    factor = factors.pop() if len(factors) == 1 else None
    _assign(guess, phalanx.name, [column.name for column in group], factor or 1.0, why)
