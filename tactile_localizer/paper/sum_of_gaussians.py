"""Sum-of-Gaussians measurement model (paper, III-C, Eq. 4)."""

from typing import Any

import numpy as np

from tactile_localizer.core.likelihood.base import MeasurementModel, checked, training_pairs
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.paper.kernel_density import KernelDensity
from tactile_localizer.paper.kernel_widths import kernel_widths
from tactile_localizer.scene import Scene


class SumOfGaussians(MeasurementModel):
    """Kernel density with a Gaussian kernel in state and strain at every training pair (paper, Eq. 4).

    Parameters
    ----------
    scan, scene : training pairs and scene
    position_std : square root of the diagonal of Sigma_x, one number or one per axis, m (yaw: rad); ``None``:
        chosen from the scan
    strain_std : square root of the diagonal of Sigma_z, one number or one per channel, V; ``None``: the same
    conditional : divide by the density of the scan in x, correct for an uneven scan; ``False``: the
        paper's joint form with constant P(x)

    Raises
    ------
    ParameterError
        A width out of its range, or a lattice too large for the memory.
    SceneError
        The scene names a phalanx that the scan does not have.
    """

    def __init__(
        self,
        scan: Scan,
        scene: Scene,
        position_std: Any = None,
        strain_std: Any = None,
        conditional: bool = True,
    ) -> None:
        positions, strain = training_pairs(scan, scene)
        self._layout = scene.layout
        self._density = KernelDensity(
            positions,
            strain,
            *kernel_widths(scan, scene, position_std, strain_std),
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
