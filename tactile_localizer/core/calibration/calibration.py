"""What is learned from held-out sweeps, and kept with a scan."""

from typing import NamedTuple

import numpy as np

from tactile_localizer.core.calibration.examination import Examination
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.core.likelihood.strain_map import VarianceModel


class Calibration(NamedTuple):
    """Parameters learned from held-out sweeps.

    Parameters
    ----------
    registration_std : (d,) m (yaw: rad), standard deviation of the shift between sweeps
    material : kind of the material
    variance : variance model of the sweeps; ``None``: not stored
    examination : of the scan, which gives the kind of the material and the information length
    """

    registration_std: np.ndarray
    material: Material = Material.CLOTH
    variance: VarianceModel | None = None
    examination: Examination = Examination()
