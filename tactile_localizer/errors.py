"""Exceptions of the package, by kind of failure.

::

    TactileLocalizerError
    ├── SceneError        invalid scene: unknown axis or phalanx, wrong bounds
    ├── ScanError         scan or recording that cannot be read, written or matched to its scene
    ├── CanError          unsuitable CAN database, or an interface that cannot be opened
    ├── ParameterError    parameter out of range or of the wrong type
    ├── MeasurementError  strain vector or pose that is not finite or has the wrong shape
    └── LiveError         node that ended unexpectedly or did not respond in time

Each message is one line that names the object, what was expected and what was found. The command line
prints it after ``error:`` and exits with status 2; a node logs it and rejects the transition.
"""

import traceback
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches

_MAX_LENGTH = 800
"""Longest message, characters; the middle of a longer one is left out."""

_MAX_REASON = 300
"""Longest text of an exception of another package, characters."""

_MAX_LISTED = 20
"""Most names listed in a message."""


def printable(text: str) -> str:
    """``text`` in one line, with line breaks, control characters and lone surrogates escaped."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def listed(names: Iterable[str]) -> str:
    """Names for a message, cut to a reasonable number and length."""
    shown = [printable(name.strip()[:40]) for name in names]
    more = len(shown) - _MAX_LISTED
    return ", ".join(shown[:_MAX_LISTED]) + (f" and {more} more" if more > 0 else "")


def counted(number: int, what: str) -> str:
    """A number of things whose plural ends in s: ``1 sweep``, ``42 sweeps``."""
    return f"{number} {what}{'s' * (number != 1)}"


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """A hint at the name of ``known`` that is most similar to ``name``; empty if none is."""
    near = get_close_matches(name, known, n=1)
    return f" (did you mean {near[0]}?)" if near else ""


def in_one_line(error: BaseException) -> str:
    """Text of an exception in one line of bounded length, or its type where it has none."""
    return " ".join(str(error).split())[:_MAX_REASON] or type(error).__name__


def located(error: BaseException) -> str:
    """Type and text of an exception that nobody expected, and the line that raised it."""
    frames = [] if isinstance(error, SyntaxError) else traceback.extract_tb(error.__traceback__)
    location = f" ({frames[-1].filename.rpartition('/')[2]}:{frames[-1].lineno})" if frames else ""
    return f"{type(error).__name__}: {in_one_line(error)}{location}"


class TactileLocalizerError(Exception):
    """Base class of the exceptions that this package raises."""

    def __str__(self) -> str:
        """The message in one line of bounded length, because it may quote the content of a file."""
        text = printable(super().__str__())
        return text if len(text) <= _MAX_LENGTH else f"{text[: _MAX_LENGTH - 200]} ... {text[-150:]}"


class SceneError(TactileLocalizerError):
    """An invalid scene."""


class ScanError(TactileLocalizerError):
    """A scan or a recording that cannot be read, written, or matched to its scene."""


class CanError(TactileLocalizerError):
    """An unsuitable CAN database, or an interface that cannot be opened."""


class ParameterError(TactileLocalizerError, ValueError):
    """A parameter out of range or of the wrong type."""


class MeasurementError(TactileLocalizerError, ValueError):
    """A strain vector or pose that is not finite or has the wrong shape."""


class LiveError(TactileLocalizerError):
    """A node that ended unexpectedly or did not respond in time."""


@contextmanager
def refusing(expected: str, error: type[TactileLocalizerError], *kinds: type[Exception]) -> Iterator[None]:
    """Context that turns exceptions of some kinds into an ``error``: what was expected, and the reason."""
    try:
        yield
    except kinds as problem:
        reason = getattr(problem, "strerror", None) or in_one_line(problem)
        raise error(f"{expected}, {reason}") from None
