"""What differs from sweep to sweep before anything is felt: grip, temperature, tare.

Each time the hand takes hold anew, its load cells read a little differently, on featureless material as on
the feature. On featureless material the difference shows by itself: there every sweep should feel the same.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from scipy.linalg import block_diag, eigh

from tactile_localizer.core.featureless_pairs import featureless_pairs
from tactile_localizer.core.likelihood.sum_of_gaussians import training_pairs
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import SceneError
from tactile_localizer.scene import Scene

_FEWEST_PAIRS = 20
_FEWEST_SWEEPS = 3
_LENGTH = 0.003
"""m of travel that make one independent look at featureless material."""
_ANOTHER_DAY = 4.0
"""Variance of a new sweep's offset, to that of the scan's: it may differ from them twice as much as they do
from each other, which were scanned one after the other."""
_GATE = 4.0
"""Mean square over a phalanx's channels, in standard deviations, above which a strain is not featureless."""
_RIDGE = 0.05
"""Share of a channel's variance that is added to the diagonal of a covariance of few sweeps."""


class SweepOffset:
    """The offset of the present sweep, learned while the material is featureless, and removed.

    A phalanx's strain on featureless material is modelled as c + b + noise: c common to all sweeps, b the
    sweep's own, noise N(0, W) along the sweep. Over the sweeps of the scan, b is N(0, B); for a new one the
    prior is N(0, 4 B). In coordinates in which W is the identity and B diagonal, the Kalman filter of b is a
    scalar one a channel. A strain that this does not explain is not featureless and teaches nothing; so the
    offset is held over a feature.

    Parameters
    ----------
    scan : sweeps that partly run over featureless material
    scene : gives the feature's region

    Raises
    ------
    SceneError
        The scene gives no region, or fewer than three sweeps leave it.
    """

    def __init__(self, scan: Scan, scene: Scene) -> None:
        numbers, off = _counted(scan, scene)
        if scene.feature is None or len(numbers) < _FEWEST_SWEEPS:
            raise SceneError(
                f"scene {scene.name}: expected at least {_FEWEST_SWEEPS} sweeps that leave the feature's "
                f"region to know their offsets by, found {len(numbers) if scene.feature else 'no region'}"
            )
        strain = training_pairs(scan, scene)[1][off]
        index = np.searchsorted(numbers, scan.sweep[off])
        sums = np.stack([np.bincount(index, channel) for channel in strain.T], axis=1)
        means = sums / np.bincount(index)[:, None]
        self._centre = means.mean(axis=0)
        offsets, deviations = means - self._centre, strain - means[index]
        self._known = dict(zip(numbers.tolist(), offsets, strict=True))
        self.layout = layout = scene.layout
        shapes, variances = zip(
            *(_diagonalised(deviations[:, own], offsets[:, own]) for own in layout.slices), strict=True
        )
        self._shape = block_diag(*shapes)
        self._whiten = np.linalg.inv(self._shape)
        self._prior = _ANOTHER_DAY * np.concatenate(variances)
        volumes = [np.linalg.slogdet(shape)[1] for shape in shapes]
        self._log_constants = -layout.expand(np.array(volumes) / layout.counts) - 0.5 * math.log(
            2.0 * math.pi
        )
        self.reset()

    def reset(self) -> None:
        """Forget the present sweep."""
        self._offset = np.zeros_like(self._prior)
        self._variance = self._prior
        self._volts = np.zeros_like(self._prior)

    def removed_from(self, scan: Scan, scene: Scene) -> Scan:
        """The scan without its sweeps' offsets; sweeps that never leave the feature keep theirs."""
        strain = scan.strain.copy()
        channels = scene.channels(scan.phalanges, scan.channels)
        for number, offset in self._known.items():
            rows = np.flatnonzero(scan.sweep == number)
            strain[np.ix_(rows, channels)] -= offset
        return dataclasses.replace(scan, strain=strain)

    def log_density(self, strain: np.ndarray, present: np.ndarray) -> float:
        """Of a strain (C,), V, of the phalanges ``present`` (F,) on featureless material, nats.

        With what is known of the present sweep's offset so far: at first, that of any sweep.
        """
        innovation = self._innovation(strain)
        variance = 1.0 + self._variance
        terms = self._log_constants - 0.5 * (innovation * innovation / variance + np.log(variance))
        return float(terms[self.layout.expand(present)].sum())

    def corrected(self, strain: np.ndarray, present: np.ndarray, travel: float) -> np.ndarray:
        """Learn from a strain, where it is featureless, and return it without the offset.

        Parameters
        ----------
        strain : (C,) V
        present : (F,) bool, the phalanges that were felt
        travel : m since the last strain
        """
        innovation = self._innovation(strain)
        squares = self.layout.sum(innovation * innovation / (1.0 + self._variance)) / self.layout.counts
        featureless = present & (squares < _GATE)
        if featureless.any():
            noise = max(1.0, _LENGTH / travel)
            gain = self.layout.expand(featureless) * self._variance / (self._variance + noise)
            self._offset = self._offset + gain * innovation
            self._variance = (1.0 - gain) * self._variance
            self._volts = self._shape @ self._offset
        return strain - self._volts

    def _innovation(self, strain: np.ndarray) -> np.ndarray:
        """What differs from featureless material, in deviations of its noise, the offset known: (C,)."""
        return np.asarray(self._whiten @ (strain - self._centre) - self._offset)


def knows_offsets(scan: Scan, scene: Scene) -> bool:
    """Whether the offsets of the scan's sweeps can be known, with one sweep to spare that is held out."""
    return scene.feature is not None and len(_counted(scan, scene)[0]) > _FEWEST_SWEEPS


def _counted(scan: Scan, scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """The sweeps that have enough featureless pairs, and the indices of those pairs."""
    off = np.flatnonzero(featureless_pairs(scan, scene))
    numbers, counts = np.unique(scan.sweep[off], return_counts=True)
    long = numbers[counts >= _FEWEST_PAIRS]
    return long, off[np.isin(scan.sweep[off], long)]


def _diagonalised(deviations: np.ndarray, offsets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A with W = A A^T and B = A diag(v) A^T, of one phalanx: (c, c) and v (c,) for its c channels."""
    within = deviations.T @ deviations / len(deviations)
    between = offsets.T @ offsets / len(offsets)
    tiny = 1e-12 * max(float(within.trace()), float(between.trace())) + 1e-30
    within += np.diag(_RIDGE * (np.diag(within) + np.diag(between)) + tiny)
    # As many sweeps as there are channels say little of how channels go together: as if so many more had been
    # seen in which they do not (the mean of an inverse Wishart posterior).
    doubt = offsets.shape[1] / (offsets.shape[1] + len(offsets))
    between = (1.0 - doubt) * between + doubt * np.diag(np.diag(between))
    variances, vectors = eigh(between, within)
    return np.linalg.inv(vectors.T), np.maximum(variances, 0.0)
