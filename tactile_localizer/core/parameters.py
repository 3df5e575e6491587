"""Parameters of the measurement models that depend on the material and the hand."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactile_localizer.errors import ParameterError


@dataclass(frozen=True)
class ModelParameters:
    """What a scene may give under ``measurement``; ``None``: to be chosen from the scan.

    Parameters
    ----------
    position_std : kernel width in position, one number or one an axis, m (yaw: rad); the paper's S_x is
        its square
    strain_std : kernel width in strain, one number or one a channel, V; the paper's S_z is its square
    correlation_length : m of travel that make one independent measurement
    correlation_change : change of the strain, in kernel widths, that makes one; ``None``: only travel counts
    interpolate : whether the sum of Gaussians also has pairs interpolated between the sweeps; ``None``: not
    sweep_offset : whether a sweep's own offset is learned on featureless material and removed; ``None``: not
    neighbours : nearest pairs of the Gaussian models; the paper has 8
    """

    position_std: Any = None
    strain_std: Any = None
    correlation_length: float | None = None
    correlation_change: float | None = None
    interpolate: bool | None = None
    sweep_offset: bool | None = None
    neighbours: int = 8

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> ModelParameters:
        """From a scene's ``measurement`` entry.

        Raises
        ------
        ParameterError
            An unknown name, or a value that is not positive.
        """
        names = [field.name for field in dataclasses.fields(cls)]
        for name in values:
            if name not in names:
                raise ParameterError(f"measurement {name!r}: expected one of {', '.join(names)}")
        parameters = cls(**values)
        for name, value in values.items():
            if name not in ("interpolate", "sweep_offset"):
                _require_positive(name, value)
            elif not isinstance(value, bool):
                raise ParameterError(f"measurement {name}: expected true or false, got {value!r}")
        if not isinstance(parameters.neighbours, int):
            raise ParameterError(
                f"measurement neighbours: expected a whole number, got {parameters.neighbours!r}"
            )
        return parameters

    @property
    def complete(self) -> bool:
        """Whether nothing is left to choose."""
        return all(
            value is not None for value in (self.position_std, self.strain_std, self.correlation_length)
        )

    def filled_from(self, chosen: ModelParameters) -> ModelParameters:
        """These parameters, with what is missing taken from ``chosen``."""
        missing = {name: getattr(chosen, name) for name, value in vars(self).items() if value is None}
        return dataclasses.replace(self, **missing)

    def to_mapping(self) -> dict[str, Any]:
        """As plain numbers and lists of four digits, for a scene file."""
        return {name: _plain(value) for name, value in vars(self).items() if value is not None}


def _require_positive(name: str, value: Any) -> None:
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise ParameterError(f"measurement {name}: expected numbers, got {value!r}") from None
    if array.size == 0 or not (np.isfinite(array).all() and (array > 0).all()):
        raise ParameterError(f"measurement {name}: expected positive numbers, got {value!r}")


def _plain(value: Any) -> Any:
    if isinstance(value, bool | int):
        return value
    values = np.asarray(value, dtype=np.float64)
    return float(f"{values:.4g}") if values.ndim == 0 else [float(f"{each:.4g}") for each in values]
