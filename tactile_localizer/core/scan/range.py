"""Range of a scan, outside of which strains and positions point to a wrong unit, wiring or force."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Scene

_MARGIN = 0.5
"""Share of a channel's range by which another session may exceed it at either end. By judgement."""
MATERIAL_SHARE = 0.1
"""Fraction of strains or positions outside of the range above which a warning is given (judgement)."""


@dataclass(frozen=True)
class ScanRange:
    """Strains that a scan has, and how far the palm can move on its scene.

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
        """Range of the phalanges and axes of ``scene`` in ``scan``."""
        strain = scan.strain[:, scene.channels(scan.phalanges, scan.channels)]
        lower, upper = strain.min(axis=0), strain.max(axis=0)
        margin = _MARGIN * (upper - lower)
        extent = np.where(scene.wraps, np.inf, scene.upper - scene.lower)
        return cls(scene.layout, lower - margin, upper + margin, extent)

    def strains_outside(self, strain: np.ndarray, present: np.ndarray) -> np.ndarray:
        """Whether strains (..., C), V, are out of range in a phalanx that is ``present`` (..., F)."""
        outside = (strain < self.lower) | (strain > self.upper)
        return np.any(outside & self.layout.expand(present), axis=-1)

    def positions_outside(self, positions: np.ndarray, start: np.ndarray) -> np.ndarray:
        """Whether positions (..., d) are farther from ``start`` (d,) than the scene is long."""
        return np.any(np.abs(positions - start) > self.extent, axis=-1)


def describe_misfit(strains: float, positions: float) -> str:
    """One line on the shares of strains and positions that are outside; empty where both are small."""
    found = []
    if strains > MATERIAL_SHARE:
        found.append(
            f"{strains:.0%} of the strains are outside the range of the scan "
            "(unit, tare, order of the phalanges, force, or another sensor?)"
        )
    if positions > MATERIAL_SHARE:
        found.append(
            f"{positions:.0%} of the positions are farther from the start than the scene is long "
            "(unit, frame, or the hand has left the material?)"
        )
    return "; ".join(found)
