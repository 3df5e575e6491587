"""The training scan as arrays: palm positions and what the fingers felt there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_localizer.errors import ScanError
from tactile_localizer.scene import GAUGES


@dataclass(frozen=True)
class Scan:
    """State-measurement pairs D = {(x_n, z_n)} (paper, III-B), in the order in which they were felt.

    Parameters
    ----------
    states : (N, d) palm positions relative to the material, m (yaw: rad)
    strain : (N, 8F) strain voltages, V, 8 a phalanx in the order of ``phalanges``
    sweep : (N,) int, number of the sweep that each pair belongs to
    axes : names of the d axes
    phalanges : names of the F phalanges

    Raises
    ------
    ScanError
        Shapes that do not match, no pairs at all, or values that are not finite.
    """

    states: np.ndarray
    strain: np.ndarray
    sweep: np.ndarray
    axes: tuple[str, ...]
    phalanges: tuple[str, ...]

    def __post_init__(self) -> None:
        n = len(self.states)
        if n == 0:
            raise ScanError("scan: expected at least one state-measurement pair, found none")
        expected = {
            "states": (n, len(self.axes)),
            "strain": (n, GAUGES * len(self.phalanges)),
            "sweep": (n,),
        }
        for name, shape in expected.items():
            found = getattr(self, name).shape
            if found != shape:
                raise ScanError(f"scan {name}: expected shape {shape}, got {found}")
        for name in ("states", "strain"):
            if not np.all(np.isfinite(getattr(self, name))):
                raise ScanError(f"scan {name}: expected finite values, found NaN or infinity")

    def __len__(self) -> int:
        return len(self.states)

    def select(self, keep: np.ndarray) -> Scan:
        """The pairs that ``keep`` (boolean mask or indices) names."""
        return Scan(self.states[keep], self.strain[keep], self.sweep[keep], self.axes, self.phalanges)

    @property
    def sweep_numbers(self) -> np.ndarray:
        """The sweeps' numbers, ascending."""
        return np.unique(self.sweep)
