"""The position-blind explanation of a strain: featureless material, or material that was never scanned."""

from __future__ import annotations

import math

import numpy as np

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.credit import Credit
from tactile_localizer.core.featureless_pairs import featureless_pairs
from tactile_localizer.core.filters.weights import log_mean
from tactile_localizer.core.fit import HeldOutFit
from tactile_localizer.core.likelihood.kernels.background import Background
from tactile_localizer.core.likelihood.kernels.normal import Normal
from tactile_localizer.core.likelihood.sum_of_gaussians import training_pairs
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Scene

_LOG_2 = math.log(2.0)
_FEWEST = 20
"""Featureless pairs below which the whole scan stands in for featureless material."""
_RIDGE = 0.05
"""Share of a channel's own variance that is added to the diagonal of every covariance."""


class NullModel:
    """How well a strain is explained without knowing the position.

    Two explanations, of which the better counts. *Featureless*: a training sweep's own Gaussian over the
    featureless material, or that of a new sweep, whose mean differs from sweep to sweep. *Unknown*: material
    that was never scanned, which explains anything as well as the map explains the worst of its own held-out
    sweeps. Whatever the belief explains better than both speaks for its position; small idiosyncrasies of one
    sweep over featureless material do not, because the null may have them too.

    Parameters
    ----------
    strain : (N, C) the scan, V
    sweep : (N,) int, sweep of each pair
    featureless : (N,) bool, pairs that are known not to touch the feature (the paper's Lambda)
    background : the broad background of the measurement model, a lower limit for the unknown
    unknown : log-density of a strain on unknown material; ``None``: the background alone
    blur : (C,) widths to which the measurement model blurs strains, V; ``None``: it does not
    """

    def __init__(
        self,
        strain: np.ndarray,
        sweep: np.ndarray,
        featureless: np.ndarray,
        background: Background,
        unknown: HeldOutFit | None = None,
        blur: np.ndarray | None = None,
    ) -> None:
        if np.count_nonzero(featureless) < _FEWEST:
            featureless = np.ones(len(strain), dtype=bool)
        strain, sweep = strain[featureless], sweep[featureless]
        self._background, layout = background, background.layout
        self._unknown = unknown if unknown is not None else HeldOutFit.unknown(layout.phalanges)
        numbers, index = np.unique(sweep, return_inverse=True)
        counts = np.bincount(index).astype(np.float64)
        means = (
            np.stack([np.bincount(index, weights=channel) for channel in strain.T], axis=1) / counts[:, None]
        )
        self._centre = strain.mean(axis=0)
        deviation = strain - means[index]
        within = deviation.T @ deviation / len(strain)
        shift = means - self._centre
        between = (shift * counts[:, None]).T @ shift / len(strain)
        ridge = np.diag(
            _RIDGE * (np.diag(within) + np.diag(between)) + (1e-6 * np.abs(strain).max(axis=0)) ** 2 + 1e-24
        )
        known = within + ridge
        # The mean of a new sweep is as uncertain as those of the known ones differ, and a little more.
        new = within + between * (1.0 + 1.0 / len(numbers)) + ridge
        self._featureless = _SweepsAndOneMore(layout, means, known, self._centre, new)
        self._blurred = None
        if blur is not None:
            self._blurred = _SweepsAndOneMore(
                layout, means, known + np.diag(blur**2), self._centre, new + np.diag(blur**2)
            )

    @classmethod
    def of_scan(
        cls,
        scan: Scan,
        scene: Scene,
        strain_std: np.ndarray,
        unknown: HeldOutFit | None = None,
        blur: np.ndarray | None = None,
    ) -> NullModel:
        """That of a scan, with the scene's region to tell what is featureless.

        ``strain_std`` (C,): a lower limit for the spread of the background, V; the others as for the class.
        """
        strain = training_pairs(scan, scene)[1]
        background = Background(strain, strain_std, scene.layout)
        return cls(strain, scan.sweep, featureless_pairs(scan, scene), background, unknown, blur)

    def featureless(self, strain: np.ndarray, present: np.ndarray) -> float:
        """Log-density of a strain (C,), V, of the phalanges ``present`` (F,) on featureless material."""
        return self._featureless.log_density(strain, present)

    def credit(self, strain: np.ndarray, present: np.ndarray) -> Credit:
        """What a believed place may claim of a strain, where it is featureless; see :class:`.Credit`."""
        featureless = self.featureless(strain, present)
        if self._blurred is None:
            return Credit(featureless, featureless)
        return Credit(featureless, self._blurred.log_density(strain, present))

    def unknown(self, strain: np.ndarray, present: np.ndarray) -> float:
        """Log-density of a strain on material that was never scanned."""
        return max(self._unknown.of(present), self._background.log_density(strain, present))

    def log_density(self, strain: np.ndarray, present: np.ndarray) -> float:
        """Log-density of a strain by the better of the two explanations."""
        return max(self.featureless(strain, present), self.unknown(strain, present))


class _SweepsAndOneMore:
    """Half known sweeps with means (K, C) and one covariance, half a new one."""

    def __init__(
        self,
        layout: ChannelLayout,
        means: np.ndarray,
        known: np.ndarray,
        centre: np.ndarray,
        new: np.ndarray,
    ) -> None:
        self._layout, self._means = layout, means
        self._known, self._new = Normal(np.zeros(len(centre)), known), Normal(centre, new)
        self._marginals: dict[bytes, tuple[Normal, Normal, np.ndarray, np.ndarray]] = {}

    def log_density(self, strain: np.ndarray, present: np.ndarray) -> float:
        key = present.tobytes()
        if key not in self._marginals:
            columns = self._layout.expand(present)
            known, new = (normal.marginal(columns) for normal in (self._known, self._new))
            self._marginals[key] = known, new, self._means[:, columns], columns
        known, new, means, columns = self._marginals[key]
        strain = strain[columns]
        # The known sweeps share one covariance: their densities are that of the deviation from each mean.
        of_known = log_mean(known.log_density(strain - means))
        return float(np.logaddexp(of_known, new.log_density(strain)) - _LOG_2)
