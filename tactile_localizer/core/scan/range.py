"""Range of a scan, outside of which strains and positions indicate a wrong unit, wiring or force."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Scene

_MARGIN = 0.5
"""Fraction of a channel's range by which another session may exceed it at either end. By judgement."""
WARNING_FRACTION = 0.1
"""Fraction of strains or positions out of range above which a warning is given. By judgement."""


@dataclass(frozen=True)
class ScanRange:
    """Range of the strains of a scan, and of the palm's displacement on its scene.

    Parameters
    ----------
    layout : channels of each phalanx
    lower, upper : (C,) least and largest strain of each channel, with a margin, V
    extent : (d,) m (yaw: rad), longest displacement on each axis; infinite where the axis wraps
    """

    layout: ChannelLayout
    lower: np.ndarray
    upper: np.ndarray
    extent: np.ndarray

    @classmethod
    def of(cls, scan: Scan, scene: Scene) -> ScanRange:
        """Range of a scan for the phalanges and axes of ``scene``."""
        strain = scan.strain_on(scene)
        lower, upper = strain.min(axis=0), strain.max(axis=0)
        margin = _MARGIN * (upper - lower)
        extent = np.where(scene.wraps, np.inf, scene.extent)
        return cls(scene.layout, lower - margin, upper + margin, extent)

    def strains_outside(self, strain: np.ndarray, present: np.ndarray) -> np.ndarray:
        """Whether strains (..., C), V, are out of range in any ``present`` (..., F) phalanx: (...)."""
        outside = (strain < self.lower) | (strain > self.upper)
        return np.logical_or.reduce(outside & self.layout.expand(present), axis=-1)

    def positions_outside(self, positions: np.ndarray, start: np.ndarray) -> np.ndarray:
        """Whether positions (..., d) are farther from ``start`` (d,) than the scene is long: (...)."""
        return np.any(np.abs(positions - start) > self.extent, axis=-1)


def describe_misfit(strains: float, positions: float) -> str:
    """Warning about the fractions of strains and positions out of range; empty if both are small."""
    found = []
    if strains > WARNING_FRACTION:
        found.append(
            f"{strains:.0%} of the strains are outside the range of the scan "
            "(unit, tare, order of the phalanges, force, or another sensor?)"
        )
    if positions > WARNING_FRACTION:
        found.append(
            f"{positions:.0%} of the positions are farther from the start than the scene is long "
            "(unit, frame, or has the hand left the material?)"
        )
    return "; ".join(found)
