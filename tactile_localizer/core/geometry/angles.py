"""Angles on the circle."""

import math

import numpy as np


def wrap_angle(angle: np.ndarray) -> np.ndarray:
    """The same angle in [-pi, pi), rad; one that is there already keeps every bit."""
    return angle - math.tau * np.floor((angle + math.pi) / math.tau)
