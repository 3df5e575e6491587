"""Sum-of-Gaussians measurement model (paper, III-C, Eq. 4)."""

from __future__ import annotations

from typing import Any

import numpy as np

from tactile_localizer.core.likelihood.base import MeasurementModel, checked, training_pairs
from tactile_localizer.core.likelihood.kernel_density import KernelDensity
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Scene


class SumOfGaussians(MeasurementModel):
    """Kernel density with a Gaussian kernel in state and strain at every training pair (paper, Eq. 4).

    Parameters
    ----------
    scan, scene : training pairs and scene
    position_std : square root of the diagonal of Sigma_x, one number or one per axis, m (yaw: rad)
    strain_std : square root of the diagonal of Sigma_z, one number or one per channel, V
    conditional : divide by the density of the scan in x, correct for an uneven scan; ``False``: the
        paper's joint form with constant P(x)

    Raises
    ------
    ParameterError
        A lattice too large for the memory.
    SceneError
        The scene names a phalanx that the scan does not have.
    """

    def __init__(
        self, scan: Scan, scene: Scene, position_std: Any, strain_std: Any, conditional: bool = True
    ) -> None:
        positions, strain = training_pairs(scan, scene)
        self._layout = scene.layout
        self._density = KernelDensity(
            positions,
            strain,
            np.broadcast_to(position_std, scene.dimension),
            np.broadcast_to(strain_std, self._layout.size),
            scene.wraps,
            self._layout,
            conditional=conditional,
        )

    def log_likelihood(
        self, states: np.ndarray, strain: np.ndarray, present: np.ndarray | None = None
    ) -> np.ndarray:
        """See :meth:`MeasurementModel.log_likelihood`."""
        strain, present = checked(strain, self._layout, present)
        return self._density.log_density(states, strain, present)
