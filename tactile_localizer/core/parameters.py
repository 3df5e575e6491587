"""Parameters of the kernel and Gaussian models that depend on the material and the hand."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactile_localizer.errors import ParameterError
from tactile_localizer.quantity import number, whole_number
from tactile_localizer.scene import LARGEST_POSITION, LARGEST_STRAIN, Scene

_SMALLEST = 1e-12
"""Least width, far below the resolution of any sensor; squares of its reciprocal do not overflow in sums."""
_LARGEST = {
    "position_std": LARGEST_POSITION,
    "strain_std": LARGEST_STRAIN,
    "correlation_length": LARGEST_POSITION,
}
_MOST_NEIGHBOURS = 10_000


@dataclass(frozen=True)
class ModelParameters:
    """Entries of a scene under ``measurement``; ``None``: chosen from the scan.

    Parameters
    ----------
    position_std : kernel width in position, one number or one per axis, m (yaw: rad); the square root of
        the paper's S_x
    strain_std : kernel width in strain, one number or one per channel, V; the square root of the paper's S_z
    correlation_length : m of travel per independent measurement
    neighbours : number of nearest pairs of the Gaussian models; 8 in the paper
    """

    position_std: Any = None
    strain_std: Any = None
    correlation_length: float | None = None
    neighbours: int = 8

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> ModelParameters:
        """From a scene's ``measurement`` entry.

        Raises
        ------
        ParameterError
            An unknown name, or a value out of its range.
        """
        names = [field.name for field in dataclasses.fields(cls)]
        checked: dict[str, Any] = {}
        for name, value in values.items():
            what = f"measurement {name}"
            if name not in names:
                raise ParameterError(f"measurement {name!r}: expected one of {', '.join(names)}")
            if name == "neighbours":
                checked[name] = whole_number(value, what, lower=1, upper=_MOST_NEIGHBOURS)
            else:
                checked[name] = _positive(value, what, _LARGEST[name])
        return cls(**checked)

    @classmethod
    def of_scene(cls, scene: Scene) -> ModelParameters:
        """From a scene.

        Raises
        ------
        ParameterError
            As :meth:`from_mapping`; or the number of widths does not fit the scene.
        """
        parameters = cls.from_mapping(scene.measurement)
        for name, count in (("position_std", scene.dimension), ("strain_std", scene.layout.size)):
            width = getattr(parameters, name)
            if isinstance(width, list) and len(width) not in (1, count):
                raise ParameterError(f"measurement {name}: expected one number or {count}, got {len(width)}")
        return parameters


def _positive(value: Any, what: str, largest: float) -> Any:
    """One positive number, or a list of them."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, list | tuple):
        if not value:
            raise ParameterError(f"{what}: expected a number or a list of numbers, got none")
        return [number(each, what, lower=_SMALLEST, upper=largest) for each in value]
    return number(value, what, lower=_SMALLEST, upper=largest)
