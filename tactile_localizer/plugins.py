"""Entry points by which other packages add readers of recordings and measurement models to this one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING

from tactile_localizer.errors import TactileLocalizerError, listed, located

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint


@cache  # a search takes 40 ms where ROS is installed
def installed(group: str) -> Mapping[str, list[EntryPoint]]:
    """Entry points of a group by their names; several of one name are of as many packages."""
    from importlib.metadata import entry_points  # takes a while to import

    found: dict[str, list[EntryPoint]] = {}
    for entry in entry_points(group=group):
        found.setdefault(entry.name, []).append(entry)
    return found


def only(entries: list[EntryPoint], error: type[TactileLocalizerError]) -> tuple[EntryPoint, str]:
    """The entry point of a name, and the package that it is of.

    Raises
    ------
    TactileLocalizerError
        As ``error``: several packages have one of that name.
    """
    packages = sorted(entry.dist.name for entry in entries if entry.dist)
    if len(entries) > 1:
        what = f"{entries[0].group} {entries[0].name}"
        raise error(
            f"{what}: expected one package that has it, found {listed(packages)}; uninstall the others"
        )
    return entries[0], "".join(packages)


@contextmanager
def named_faults(what: str, expected: str, error: type[TactileLocalizerError]) -> Iterator[None]:
    """Context in which a failure of code that is not ours becomes an ``error`` that says where it is."""
    try:
        yield
    except TactileLocalizerError:
        raise
    except (Exception, SystemExit) as fault:
        raise error(f"{what}: expected {expected}, {located(fault)}") from None
