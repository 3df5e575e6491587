"""The paper's measurement models as the paper has them, which ``paper.py`` names as a user names a model.

Its widths are set by hand (III-C), its sum of Gaussians is the joint form, and every strain counts as a whole
measurement.
"""

import numpy as np

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.paper import Featureless, Gaussian, IndependentGaussian, SumOfGaussians
from tactile_localizer.scene import Scene

POSITION_STD = 0.0254 * float(np.sqrt(0.0075))
"""Square root of the paper's S_x, m."""
STRAIN_STD = float(np.sqrt(0.001))
"""Square root of the paper's S_z, V."""


class _Whole:
    """No tempering: each update is a measurement."""

    information_length = Configuration().update_distance


class PaperSum(_Whole, SumOfGaussians):
    """Eq. 4 in joint form."""

    def __init__(self, scan: Scan, scene: Scene) -> None:
        super().__init__(scan, scene, POSITION_STD, STRAIN_STD, conditional=False)


class PaperFeatureless(_Whole, Featureless):
    """Eq. 5 to 7."""

    def __init__(self, scan: Scan, scene: Scene) -> None:
        super().__init__(scan, scene, POSITION_STD, STRAIN_STD)


class PaperGaussian(_Whole, Gaussian):
    """Eq. 3, of the 8 nearest pairs."""


class PaperIndependent(_Whole, IndependentGaussian):
    """The same without covariance between the fingers."""
