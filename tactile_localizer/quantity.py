"""Conversion and range check of numbers from files and parameters.

Numbers and their text are accepted: ``3e-3``, ``.5``, and angles such as ``pi``, ``-pi``, ``2*pi``, ``pi/2``.
Booleans, other text and NaN are rejected; so is infinity, unless it is explicitly allowed.
"""

from __future__ import annotations

import math
import re
import reprlib
from typing import Any

from tactile_localizer.errors import ParameterError

_DECIMAL = r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_NUMBER = re.compile(rf"[+-]?{_DECIMAL}", re.ASCII)
_MULTIPLE_OF_PI = re.compile(rf"([+-]?)(?:({_DECIMAL})\s*\*\s*)?pi(?:\s*/\s*({_DECIMAL}))?", re.ASCII)
_INFINITY = re.compile(r"([+-]?)\.?inf", re.IGNORECASE)
_MAX_LENGTH = 40
"""Longest text of a number, characters."""


def number(
    value: Any,
    what: str,
    *,
    lower: float = -math.inf,
    upper: float = math.inf,
    finite: bool = True,
) -> float:
    """Convert ``value`` to a float and check its range.

    Parameters
    ----------
    value : a number, or its text
    what : name of the value, for the message
    lower, upper : inclusive range
    finite : whether infinity is rejected

    Raises
    ------
    ParameterError
        The value is not a number, or out of range.
    """
    found = _converted(value)
    if found is None or math.isnan(found) or (finite and math.isinf(found)):
        raise ParameterError(f"{what}: expected a {'finite ' * finite}number, got {_shown(value)}")
    if not (lower <= found <= upper):
        raise ParameterError(f"{what}: expected {_range(lower, upper)}, got {_shown(value)}")
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
        raise ParameterError(f"{what}: expected a whole number, got {_shown(value)}")
    return value if type(value) is int else int(found)


def is_number(value: Any) -> bool:
    """Whether :func:`number` accepts ``value``, apart from its range."""
    found = _converted(value)
    return found is not None and not math.isnan(found)


def _converted(value: Any) -> float | None:
    if isinstance(value, str):
        return _parse(value.strip()) if len(value) <= _MAX_LENGTH else None
    if isinstance(value, bool) or not hasattr(value, "__float__"):
        return None
    try:
        return float(value)
    except (TypeError, ValueError):
        return None
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def _parse(text: str) -> float | None:
    if _NUMBER.fullmatch(text):
        return float(text)
    if found := _MULTIPLE_OF_PI.fullmatch(text):
        sign, factor, divisor = found.groups()
        divided = float(divisor or 1.0)
        if divided == 0.0:
            return None
        return (-1.0 if sign == "-" else 1.0) * float(factor or 1.0) * math.pi / divided
    if found := _INFINITY.fullmatch(text):
        return -math.inf if found[1] == "-" else math.inf
    return None


def _range(lower: float, upper: float) -> str:
    if math.isinf(lower):
        return f"at most {upper:g}"
    return f"at least {lower:g}" if math.isinf(upper) else f"{lower:g} to {upper:g}"


def _shown(value: Any) -> str:
    return repr(value) if isinstance(value, bool | float) else reprlib.repr(value)
