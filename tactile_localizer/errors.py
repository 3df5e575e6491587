"""The package's exceptions: one small tree, so that callers can catch by what went wrong.

::

    TactileLocalizerError
    ├── SceneError      a scene that cannot be used (unknown axis, phalanx, bounds)
    ├── ScanError       a scan file or recording that cannot be read, written or matched to its scene
    ├── CanError        a DBC without the signals, an interface that cannot be opened
    ├── ParameterError  a parameter out of its range or of the wrong kind
    ├── MeasurementError  a strain vector or pose that is not finite or not of the expected shape
    └── LiveError       a node of a running system that ended, or did not answer in time

Every message is one line that names the thing, what was expected and what was found. The command
line prints it after ``error:`` and exits with status 2; a node logs it and refuses the transition.
"""

_LONGEST = 800
"""Characters of a message, from which its middle is left out."""


def printable(text: str) -> str:
    """``text`` in one line, with line ends, control characters and lone surrogates as escapes."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


class TactileLocalizerError(Exception):
    """Base of everything that this package raises on purpose."""

    def __str__(self) -> str:
        """The message in one line of bounded length: it may quote what is in a file."""
        text = printable(super().__str__())
        return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 200]} ... {text[-150:]}"


class SceneError(TactileLocalizerError):
    """A scene description that cannot be used."""


class ScanError(TactileLocalizerError):
    """A scan file or a recording that cannot be read, written, or matched to its scene."""


class CanError(TactileLocalizerError):
    """A CAN database or interface that cannot be used."""


class ParameterError(TactileLocalizerError, ValueError):
    """A parameter out of its range or of the wrong kind."""


class MeasurementError(TactileLocalizerError, ValueError):
    """A strain vector or pose that is not finite or not of the expected shape."""


class LiveError(TactileLocalizerError):
    """A node of a running system that ended, or did not answer in time."""
