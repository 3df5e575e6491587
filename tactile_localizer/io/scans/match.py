"""Whether pairs recorded for two scenes can lie in one scan file."""

from __future__ import annotations

from typing import Any

from tactile_localizer.errors import ScanError
from tactile_localizer.scene import Scene


def require_same_scene(found: Scene, expected: Scene, where: str) -> None:
    """Check that pairs of both scenes can lie in one file: the same axes, bounds, phalanges and name.

    Raises
    ------
    ScanError
        They cannot; says what differs.
    """
    for what, mine, theirs in (
        ("axes", found.axis_names, expected.axis_names),
        ("lower bounds", tuple(found.lower), tuple(expected.lower)),
        ("upper bounds", tuple(found.upper), tuple(expected.upper)),
        ("phalanges", found.phalanx_names, expected.phalanx_names),
        ("channels", found.layout.counts, expected.layout.counts),
        ("phalanx offsets", _offsets(found), _offsets(expected)),
        ("name", (found.name,), (expected.name,)),
    ):
        if mine != theirs:
            raise ScanError(f"{where}: expected {what} {_text(theirs)}, found {_text(mine)}")


def _offsets(scene: Scene) -> tuple[tuple[float, ...], ...]:
    return tuple(phalanx.offset for phalanx in scene.phalanges)


def _text(values: tuple[Any, ...]) -> str:
    return ", ".join(value if isinstance(value, str) else f"{value}" for value in values)
