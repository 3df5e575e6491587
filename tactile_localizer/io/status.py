"""Status bits of a phalanx in one sample, as in ``StrainVectors.msg``."""

from __future__ import annotations

OK = 0
"""All voltages were received and are valid."""
MISSING = 1
"""At least one frame was not received; the voltages are NaN."""
SATURATED = 2
"""At least one gauge pair is at an end of its range."""
FAULT = 4
"""The load cell reports a fault, or a voltage is not finite."""
