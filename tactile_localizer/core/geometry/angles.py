"""Angles on the circle."""

from __future__ import annotations

import numpy as np


def wrap_angle(angle: np.ndarray) -> np.ndarray:
    """The same angle in [-pi, pi), rad."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi
