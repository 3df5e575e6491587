"""Lattices of states."""

import numpy as np


def flatten_axes(axes: list[np.ndarray]) -> np.ndarray:
    """All combinations of the coordinates of d axes, in C order: (C1 * ... * Cd, d)."""
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))
