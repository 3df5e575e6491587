"""Display units of figures and tables: mm, degrees for yaw."""

import numpy as np

from tactile_localizer.scene import Scene

MM = 1e3
"""Millimetres per metre."""


def display_units(axis: str, values: np.ndarray) -> np.ndarray:
    """Positions on an axis of the state in display units: mm, degrees for yaw."""
    return np.degrees(values) if axis == "yaw" else np.asarray(values) * MM


def describe_sizes(scene: Scene, sizes: np.ndarray) -> str:
    """Lengths (d,) by axis, m (yaw: rad), as text in display units."""
    return ", ".join(
        f"{axis} {display_units(axis, size):.2f}{'°' if axis == 'yaw' else ' mm'}"
        for axis, size in zip(scene.axis_names, sizes, strict=True)
    )


def literal(text: str) -> str:
    """Text with escaped dollar signs, which matplotlib would read as a formula."""
    return text.replace("$", r"\$")


def axis_label(axis: str) -> str:
    """Label of an axis of the state in display units."""
    return f"{axis}, {'degrees' if axis == 'yaw' else 'mm'}"
