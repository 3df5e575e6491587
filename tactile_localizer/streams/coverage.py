"""Coverage of the scene's bounds by a scan."""

import numpy as np

from tactile_localizer.scene import Scene

SWEEP_DISTANCE_M = 0.00254
"""Distance between sweeps in the paper, a tenth of an inch."""

SWEEP_DISTANCE_RAD = 0.1
"""The same along yaw."""

_CELLS_PER_DISTANCE = 4
_MOST_CELLS = 16_000_000
"""Of one byte each: a sheet of 2.5 m by 2.5 m."""


class Coverage:
    """Fraction of the volume within the scene's bounds that is within one sweep distance of a pair.

    Parameters
    ----------
    scene : axes and bounds
    distance_m : sweep distance, m
    distance_rad : the same along yaw, rad
    """

    def __init__(
        self, scene: Scene, distance_m: float = SWEEP_DISTANCE_M, distance_rad: float = SWEEP_DISTANCE_RAD
    ) -> None:
        distance = np.array([distance_rad if axis.name == "yaw" else distance_m for axis in scene.axes])
        extent = scene.extent
        self._lower = scene.lower
        self._shape = scene.cells(distance / _CELLS_PER_DISTANCE, most=_MOST_CELLS)
        self._cell = extent / self._shape
        # In units of the sweep distance, so that metres and radians can be compared.
        self._sampling = self._cell / distance
        self._visited = np.zeros(self._shape, dtype=bool)
        self._fraction: float | None = 0.0

    def add(self, states: np.ndarray) -> None:
        """Add pairs at ``states`` (n, d) within the bounds."""
        cells = np.clip(((states - self._lower) / self._cell).astype(int), 0, self._shape - 1)
        if not self._visited[tuple(cells.T)].all():
            self._visited[tuple(cells.T)] = True
            self._fraction = None

    @property
    def fraction(self) -> float:
        """Covered fraction, 0 to 1."""
        from scipy import ndimage

        if self._fraction is None:
            distance = ndimage.distance_transform_edt(~self._visited, sampling=self._sampling)
            self._fraction = float(np.mean(distance < 1.0))
        return self._fraction
