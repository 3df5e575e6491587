"""The paper's measurement models, for the position: plug-ins, named as a user's own (docs/models.md).

``model: tactile_localizer.paper:SumOfGaussians`` selects one with what it chooses from the scan; a subclass
gives other arguments.
"""

from tactile_localizer.paper.featureless import Featureless
from tactile_localizer.paper.gaussian import Gaussian, IndependentGaussian
from tactile_localizer.paper.sum_of_gaussians import SumOfGaussians

__all__ = ["Featureless", "Gaussian", "IndependentGaussian", "SumOfGaussians"]
