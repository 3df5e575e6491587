"""Names of values: the one grammar of a table's columns, a message's fields and a log's signals.

============================  ==========================================================================
``gauge_1``                   one
``gauge_1..8``                gauge_1 to gauge_8; with as many digits as the first has at least
``taxels.0..3.force``         the numbers may be anywhere in the name
``force.x, force.y``          several
``["Force 1, N", g1..8]``     a list: commas, signs and factors are part of its names
``x_mm * 0.001, row / 60``    a factor to the package's unit
``sec + nanosec * 1e-9 - 3``  a sum, with an offset: of a stamp, s
============================  ==========================================================================
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from itertools import groupby
from typing import Any

from tactile_localizer.errors import ParameterError, TactileLocalizerError
from tactile_localizer.quantity import LARGEST_NUMBER
from tactile_localizer.scene import MOST_CHANNELS

ROW = "row"
"""Name of the number of a row of a table, from 0."""
_RANGE = re.compile(r"(.*?)([0-9]{1,9})\.\.([0-9]{1,9})(.*)", re.DOTALL)
_SIGN = r"(?<![0-9.][eE])(?<!\*)(?<!\*\s)"
"""Before a + or - that is not part of a number."""
_OFFSET = re.compile(_SIGN + r"([-+]\s*[0-9.]+(?:[eE][-+]?[0-9]+)?)$")


@dataclass(frozen=True)
class Names:
    """Names of the values of one quantity.

    Parameters
    ----------
    names : one per channel of a phalanx; those of a stamp are added up
    factors : of each, to the package's unit
    offset : added to a stamp, s
    given : the YAML form
    """

    names: tuple[str, ...]
    factors: tuple[Decimal, ...]
    offset: Decimal = Decimal(0)
    given: str | list[str] = ""

    @classmethod
    def plain(cls, names: Iterable[str]) -> "Names":
        """Names in the package's unit."""
        names = tuple(names)
        return cls(names, (Decimal(1),) * len(names))


def parse_names(
    value: Any,
    where: str,
    *,
    several: bool = True,
    is_sum: bool = False,
    error: type[TactileLocalizerError] = ParameterError,
) -> Names:
    """Names given as a text, or as a list.

    Parameters
    ----------
    value : the YAML form
    where : what the names are of, for messages
    several : whether commas separate names
    is_sum : whether the names are added up
    error : class of the exception to raise

    Raises
    ------
    TactileLocalizerError
        As ``error``: it is neither, or a number is none.
    """
    if not isinstance(value, str | list) or not value or not all(isinstance(each, str) for each in value):
        raise error(f"{where}: expected a name or a list of names, got {value!r:.80}")
    offset = Decimal(0)
    if isinstance(value, list):
        terms = [(name, Decimal(1)) for name in value]
    elif is_sum:
        text, *shift = _OFFSET.split(value)
        offset = _number(shift[0].replace(" ", ""), where, error) if shift else offset
        terms = [_scaled(term, where, error) for term in re.split(_SIGN + r"\+", text)]
    else:
        text, factor = _scaled(value, where, error)
        terms = [(name, factor) for name in (text.split(",") if several else [text])]
    found = [(each, factor) for name, factor in terms for each in expanded(name.strip(), where, error)]
    names, factors = zip(*found, strict=True)
    return Names(names, factors, offset, value)


def expanded(name: str, where: str, error: type[TactileLocalizerError] = ParameterError) -> list[str]:
    """All names of one with a range of numbers, such as ``gauge_1..8``, or the one without.

    Raises
    ------
    TactileLocalizerError
        As ``error``: the range is empty, or too long.
    """
    if not (match := _RANGE.fullmatch(name)):
        return [name]
    before, first, last, after = match.groups()
    if not 0 <= int(last) - int(first) < MOST_CHANNELS:
        raise error(f"{where}: expected 1 to {MOST_CHANNELS} columns or fields, got {name!r:.80}")
    digits = len(first)
    return [f"{before}{number:0{digits}}{after}" for number in range(int(first), int(last) + 1)]


def ranges(numbers: Iterable[int]) -> str:
    """Ascending numbers in the form of :func:`expanded`: ``0..2, 4``."""
    runs = [
        [number for _, number in run]
        for _, run in groupby(enumerate(numbers), lambda each: each[1] - each[0])
    ]
    return ", ".join(f"{run[0]}..{run[-1]}" if len(run) > 1 else f"{run[0]}" for run in runs)


def _scaled(text: str, where: str, error: type[TactileLocalizerError]) -> tuple[str, Decimal]:
    """A text without its factor, and the factor. A / is one between blanks and before a number alone."""
    name, times, factor = text.partition("*")
    if times:
        return name, _number(factor, where, error)
    name, slash, divisor = text.rpartition("/")
    if slash and (name.endswith(" ") or name.strip() == ROW) and _is_decimal(divisor):
        return name, 1 / _number(divisor, where, error)
    return text, Decimal(1)


def _is_decimal(text: str) -> bool:
    try:
        Decimal(text)
    except InvalidOperation:
        return False
    return True


def _number(text: str, where: str, error: type[TactileLocalizerError]) -> Decimal:
    number = Decimal(text) if _is_decimal(text) else Decimal(0)
    if not number.is_finite() or not 0 < abs(number) <= LARGEST_NUMBER:
        raise error(f"{where}: expected a number after *, /, + or -, other than 0, got {text!r:.80}")
    return number
