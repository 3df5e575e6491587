"""What is the matter with a phalanx in one sample: the status bits of ``StrainVectors.msg``."""

from __future__ import annotations

OK = 0
"""All voltages arrived and are good."""
MISSING = 1
"""At least one frame did not arrive; the voltages are NaN."""
SATURATED = 2
"""At least one gauge pair stands at the end of its range."""
FAULT = 4
"""The load cell reports a fault, or a voltage is not finite."""
