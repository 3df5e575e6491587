"""The messages on ``/diagnostics``."""

from typing import Any


def status_of(diagnostics: list[Any], name: str) -> tuple[bytes, str, dict[str, str]]:
    """Level, message and values of the newest diagnostic status ``name``; nothing before the first."""
    for array in reversed(diagnostics):
        for status in array.status:
            if status.name == name:
                return status.level, status.message, {pair.key: pair.value for pair in status.values}
    return b"", "", {}
