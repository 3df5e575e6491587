"""Range of a scan, outside of which strains and positions indicate a wrong unit, wiring or force."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Scene

_MARGIN = 0.5
"""Fraction of a channel's range by which another session may exceed it at either end. By judgement."""
_STD_OF_MEDIAN = 1.4826 / math.sqrt(6.0)
"""Standard deviation of white noise by the median size of its second differences."""
_MIDDLE = (0.16, 0.84)
"""Quantiles one standard deviation from the median of a normal distribution."""
_FEWEST = 10
"""Number of samples below which a sweep has no spread."""
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
    noise : (C,) noise of each channel from sample to sample, V, in the sweep that has the least
    """

    layout: ChannelLayout
    lower: np.ndarray
    upper: np.ndarray
    extent: np.ndarray
    noise: np.ndarray

    @classmethod
    def of(cls, scan: Scan, scene: Scene) -> ScanRange:
        """Range of a scan for the phalanges and axes of ``scene``."""
        strain = scan.strain_on(scene)
        lower, upper = strain.min(axis=0), strain.max(axis=0)
        margin = _MARGIN * (upper - lower)
        extent = np.where(scene.wraps, np.inf, scene.extent)
        sweeps = np.split(strain, np.flatnonzero(np.diff(scan.sweep)) + 1)
        changes = [np.abs(np.diff(each, 2, axis=0)) for each in sweeps if len(each) >= _FEWEST]
        noise = [_STD_OF_MEDIAN * np.median(each, axis=0) for each in changes]
        least = np.min(noise, axis=0) if noise else np.zeros(len(lower))
        return cls(scene.layout, lower - margin, upper + margin, extent, least)

    def strains_outside(self, strain: np.ndarray, present: np.ndarray) -> np.ndarray:
        """Whether strains (..., C), V, are out of range in any ``present`` (..., F) phalanx: (...)."""
        outside = (strain < self.lower) | (strain > self.upper)
        return np.logical_or.reduce(outside & self.layout.expand(present), axis=-1)

    def spread(self, strain: np.ndarray) -> np.ndarray:
        """Spread of the strain (n, C), V, of a sweep by the noise of the scan: (F,), of its largest channel.

        Below 1, the strain of a phalanx varies less than noise alone does, on material without any feature,
        too. Infinite where that cannot be said.
        """
        rows = strain[np.isfinite(strain).all(axis=1)]
        if len(rows) < _FEWEST:
            return np.full(len(self.layout.counts), np.inf)
        low, high = np.quantile(rows, _MIDDLE, axis=0)
        ratio = 0.5 * (high - low) / np.where(self.noise > 0.0, self.noise, np.nan)
        ratio = np.nan_to_num(ratio, nan=np.inf)
        return np.array([part.max() for part in np.split(ratio, np.cumsum(self.layout.counts)[:-1])])

    def positions_outside(self, positions: np.ndarray, start: np.ndarray) -> np.ndarray:
        """Whether positions (..., d) are farther from ``start`` (d,) than the scene is long: (...)."""
        return np.any(np.abs(positions - start) > self.extent, axis=-1)


def describe_quiet(phalanges: Sequence[str], spread: np.ndarray) -> str:
    """Warning about ``phalanges`` whose spread (s, F) in most of the sweeps is below noise; empty if none."""
    usual = np.median(spread, axis=0) if len(spread) else np.ones(len(phalanges))
    if not (usual < 1.0).any():
        return ""
    names = " and ".join(name for name, each in zip(phalanges, usual, strict=True) if each < 1.0)
    times = f"{usual[usual < 1.0].max():.2g} times the noise of the scan"
    return f"strain of {names} varies by only {times} (a smaller unit, another gain, or no sensor?)"


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
