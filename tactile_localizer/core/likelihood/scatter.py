"""Scatter of a sweep's residuals about the map, which another force than in the scan makes larger.

A force that varies moves all channels together, so that residuals scatter in a few directions only. A
variance that is larger in these directions leaves the others as informative as they were.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core import compiled

SCATTERED = 2.0
"""Standard deviations of the strain, in those of the scan, from which another force is felt. By judgement."""


class Whitening(NamedTuple):
    """A transform of strains, after which their noise is white.

    Parameters
    ----------
    transform : (C, C) a lower triangle; of phalanges whose noise is independent a block for each
    log_volume : (F,) their shares in the logarithm of its determinant
    """

    transform: np.ndarray
    log_volume: np.ndarray

    @classmethod
    def of(cls, layout: ChannelLayout, covariance: np.ndarray) -> Whitening:
        """The one after which a ``covariance`` (C, C) is one."""
        transform = np.linalg.inv(np.linalg.cholesky(covariance))
        return cls(transform, layout.sum(np.log(transform.diagonal())))

    def after(self, other: Whitening) -> Whitening:
        """The ``other`` one, and then this one."""
        return Whitening(self.transform @ other.transform, self.log_volume + other.log_volume)


class Scatter(NamedTuple):
    """Second moments of the residuals of a sweep, normalized by the variance expected from the scan.

    Parameters
    ----------
    layout : whitened directions by phalanx
    moments : (C, C), a block per phalanx
    measurements : number of independent measurements over which they are averaged
    variance : (F,) their mean over the directions of each phalanx
    most : (F,) that no direction exceeds: the root of the sum of their squares
    """

    layout: ChannelLayout
    moments: np.ndarray
    measurements: float
    variance: np.ndarray
    most: np.ndarray

    @property
    def is_usual(self) -> bool:
        """Whether there is nothing that the scan's conditions do not explain."""
        # Of a few numbers, a loop is several times faster than arrays.
        each = zip(self.layout.counts, self.variance.tolist(), self.most.tolist(), strict=True)
        return not any(
            variance > 1.0 or most > _edge(width, self.measurements) for width, variance, most in each
        )

    @classmethod
    def of(cls, layout: ChannelLayout, moments: np.ndarray, measurements: float) -> Scatter:
        """The scatter of these moments."""
        variance = layout.mean(moments.diagonal())
        most = np.sqrt(layout.sum(np.add.reduce(np.square(moments), axis=1)))
        return cls(layout, moments, measurements, variance, most)

    @classmethod
    def start(cls, layout: ChannelLayout) -> Scatter:
        """Before the first strain: that of the scan."""
        return cls.of(layout, np.eye(layout.size), 1.0)

    def after(self, moments: np.ndarray, used: np.ndarray, share: float, measurements: float) -> Scatter:
        """The scatter after a strain.

        Parameters
        ----------
        moments : (C, C) of its residuals, where the hand may be
        used : (F,) bool, phalanges that count
        share : weight of the strain in the mean
        measurements : number of independent ones over which the mean then is
        """
        if compiled.MODULE is not None:
            phalanges = len(used)
            found = np.empty_like(self.moments), np.empty(phalanges), np.empty(phalanges)
            compiled.MODULE.average(self.moments, moments, self.layout.bounds, used, share, *found)
            return Scatter(self.layout, found[0], measurements, *found[1:])
        counted = share if used.all() else share * self.layout.expand(used)
        return Scatter.of(self.layout, self.moments + counted * (moments - self.moments), measurements)

    def moved(self, transform: np.ndarray) -> Scatter:
        """The scatter of residuals that a ``transform`` (C, C) takes to other units."""
        moments = self._within(transform @ self.moments @ transform.T)
        return Scatter.of(self.layout, moments, self.measurements)

    def along(self, direction: np.ndarray) -> Whitening | None:
        """The transform where strains scatter more along a direction (C,) of each phalanx; ``None``: nowhere.

        A force that varies multiplies what a sensor feels above its zero, which is known without a map. It
        does where the strain scatters along it by more than :data:`SCATTERED`, in what it does across it; of
        a single channel nothing is across.
        """
        layout, edge = self.layout, max(_edge(1, self.measurements), SCATTERED**2)
        if not np.count_nonzero(self.most > edge):
            return None
        direction = direction / max(float(np.abs(direction).max()), 1e-300)  # its square may be no number
        length = np.maximum(layout.sum(np.square(direction)), 1e-300)
        along = layout.sum(direction * (self.moments @ direction)) / length
        others = (layout.sum(self.moments.diagonal()) - along) / np.maximum(layout.widths - 1, 1)
        more = np.where(layout.widths > 1, along / np.maximum(others, 1.0), 0.0)
        if not np.count_nonzero(more > edge):
            return None
        width = direction * layout.expand(np.sqrt(np.where(more > edge, more - 1.0, 0.0) / length))
        return Whitening.of(layout, np.eye(layout.size) + self._within(np.outer(width, width)))

    def whitening(self, known: Whitening | None) -> Whitening | None:
        """The transform of strains whose residuals scatter as these; ``None``: as in the scan.

        Their covariance has the directions in which the moments exceed by more than chance (the edge of
        Marchenko and Pastur, 1967) the mean of those that are not larger; these have their mean. Of few
        measurements no direction is distinct, and all have one variance.

        Parameters
        ----------
        known : as from :meth:`along`, besides which there may be other directions; ``None``: no such
        """
        if known is not None:
            left = known.transform @ self.moments @ known.transform.T
            found = Scatter.of(self.layout, left, self.measurements).whitening(None)
            return known if found is None else found.after(known)
        if self.is_usual:
            return None
        layout, even = self.layout, np.maximum(self.variance, 1.0)
        edge = _edge(layout.widths, self.measurements)
        covariance = np.diag(layout.expand(even))
        for phalanx in np.flatnonzero(self.most > even * edge).tolist():
            own = layout.slices[phalanx]
            values, vectors = np.linalg.eigh(self.moments[own, own])
            variance = np.array(_evened(values.tolist(), edge[phalanx]))
            if variance[-1] > variance[0]:
                covariance[own, own] = (vectors * variance) @ vectors.T
        is_usual = np.array_equal(covariance, np.eye(layout.size))
        return None if is_usual else Whitening.of(layout, covariance)

    def _within(self, matrix: np.ndarray) -> np.ndarray:
        """The blocks of the phalanges of a ``matrix`` (C, C), and zero elsewhere."""
        return matrix * np.equal.outer(self.layout.phalanx, self.layout.phalanx)


def _evened(values: list[float], edge: float) -> list[float]:
    """Ascending moments of directions of which those that are not larger by an ``edge`` have their mean."""
    others = len(values)
    while True:
        even = max(sum(values[:others]) / others, 1.0)
        if others == 1 or values[others - 1] <= edge * even:
            return [even] * others + values[others:]
        others -= 1


def _edge(directions: Any, measurements: float) -> Any:
    """Largest ratio of moments that comes by chance, of as many directions and measurements."""
    return (1.0 + (directions / measurements) ** 0.5) ** 2
