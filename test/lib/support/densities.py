"""Reference implementation of the measurement models, pair by pair as in the paper: slow and plain."""

import math

import numpy as np
from scipy import stats
from scipy.special import logsumexp

FLOOR = 0.01


def background(strain: np.ndarray, strain_std: np.ndarray | float) -> list[stats.multivariate_t]:
    """One frozen Student-t distribution per phalanx."""
    scale = 2.0 * np.hypot(strain.std(axis=0), strain_std)
    mean = strain.mean(axis=0)
    return [
        stats.multivariate_t(mean[i : i + 8], np.diag(scale[i : i + 8] ** 2), df=8)
        for i in range(0, strain.shape[1], 8)
    ]


def sum_of_gaussians(
    positions: np.ndarray,
    strain: np.ndarray,
    position_std: np.ndarray | float,
    strain_std: np.ndarray | float,
    states: np.ndarray,
    measured: np.ndarray,
    conditional: bool = True,
    wraps: np.ndarray | bool = False,
) -> np.ndarray:
    """Log of (S + a b) / (D + a), with position kernels of peak one (paper, Eq. 4), at ``states`` (P, d)."""
    width = np.broadcast_to(position_std, states.shape[1])
    near = np.zeros((len(states), len(positions)))
    for axis, turns in enumerate(np.broadcast_to(wraps, len(width))):
        apart = states[:, axis, None] - positions[:, axis]
        near -= 0.5 * ((np.angle(np.exp(1j * apart)) if turns else apart) / width[axis]) ** 2
    kernels = stats.norm.logpdf(measured, strain, strain_std).sum(axis=1)
    extent = np.maximum(np.ptp(positions, axis=0), width * math.sqrt(2 * math.pi))
    typical = len(positions) * np.prod(width * math.sqrt(2 * math.pi) / extent)
    broad = sum(
        one.logpdf(measured[8 * i : 8 * i + 8]) for i, one in enumerate(background(strain, strain_std))
    )
    total = np.logaddexp(logsumexp(near + kernels, axis=1), math.log(FLOOR * typical) + broad)
    return total - np.log((np.exp(near).sum(axis=1) if conditional else typical) + FLOOR * typical)
