"""Status bits of a phalanx in one sample, as in ``StrainVectors.msg``."""

import numpy as np

from tactile_localizer.channels import ChannelLayout

OK = 0
"""All voltages were received and are valid."""
MISSING = 1
"""At least one frame was not received; the voltages are NaN."""
SATURATED = 2
"""At least one gauge pair is at an end of its range."""
FAULT = 4
"""The load cell reports a fault, or a voltage is not finite."""


def missing_status(strain: np.ndarray, layout: ChannelLayout) -> np.ndarray:
    """Status bits for strain without recorded status: MISSING for phalanges with values that are not finite.

    Parameters
    ----------
    strain : (..., C) strain voltages, V
    layout : channels by phalanx

    Returns
    -------
    (..., F) uint8
    """
    return np.where(layout.all(np.isfinite(strain)), OK, MISSING).astype(np.uint8)
