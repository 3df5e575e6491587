"""Range checks of numbers from files and parameters.

Booleans, text and NaN are rejected; so is infinity, unless it is explicitly allowed.
"""

import math
import reprlib
from numbers import Real
from typing import Any

from tactile_localizer.errors import ParameterError, TactileLocalizerError

LARGEST_NUMBER = 1e100
"""Largest number in a recording or a message, of which squares are finite."""


def number(
    value: Any,
    what: str,
    *,
    lower: float = -math.inf,
    upper: float = math.inf,
    finite: bool = True,
    error: type[TactileLocalizerError] = ParameterError,
) -> float:
    """Convert ``value`` to a float and check its range.

    Parameters
    ----------
    value : a number
    what : name of the value, for the message
    lower, upper : inclusive range
    finite : whether infinity is rejected
    error : class of the exception to raise

    Raises
    ------
    TactileLocalizerError
        As ``error``: the value is not a number, or out of range.
    """
    try:
        found = float(value) if is_number(value) else math.nan
    except OverflowError:
        found = math.inf
    if math.isnan(found) or (finite and math.isinf(found)):
        hint = "; remove the quotes" if isinstance(value, str) else ""
        raise error(f"{what}: expected a {'finite ' * finite}number, got {reprlib.repr(value)}{hint}")
    if not lower <= found <= upper:
        expected = f"{lower:g} to {upper:g}"
        if math.isinf(lower):
            expected = f"at most {upper:g}"
        elif math.isinf(upper):
            expected = f"at least {lower:g}"
        raise error(f"{what}: expected {expected}, got {reprlib.repr(value)}")
    return found


def whole_number(value: Any, what: str, *, lower: float = -math.inf, upper: float = math.inf) -> int:
    """Convert ``value`` to an integer and check its range; ``300.0`` and ``3e2`` are integers too.

    Raises
    ------
    ParameterError
        The value is not an integer, or out of range.
    """
    found = number(value, what, lower=lower, upper=upper)
    if not found.is_integer():
        raise ParameterError(f"{what}: expected a whole number, got {reprlib.repr(value)}")
    return int(value)


def is_number(value: Any) -> bool:
    """Whether ``value`` is a real number other than a boolean."""
    return isinstance(value, Real) and not isinstance(value, bool)
