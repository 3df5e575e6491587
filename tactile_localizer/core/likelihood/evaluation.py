"""Likelihoods of a strain vector under all hypotheses."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

INFLATION = 9.0
"""Factor by which the variance of unknown material exceeds that of the map. By judgement; tried on two
fabrics and three simulated features."""


class Evaluation(NamedTuple):
    """Log-likelihoods of one strain vector, nats, at P states of the map and under the alternatives to it.

    All are densities over the same strains with the same noise model, and therefore comparable.

    Parameters
    ----------
    position : (P,) at each state, for the position on the map
    same_material : (P,) at each state, for the probability of being on the map; the same as ``position``
        for the sweep mixture
    other_material : (P,) at each state, with a larger variance: unknown material that resembles that place
    elsewhere : average over all places of the map, half with its variance and half with a larger one
    featureless : of featureless material; ``-inf`` if the scanned material has features everywhere
    nodes : (P,) indices of the map's nodes nearest to the states
    """

    position: np.ndarray
    same_material: np.ndarray
    other_material: np.ndarray
    elsewhere: float
    featureless: float
    nodes: np.ndarray


class Expected(NamedTuple):
    """A whitened strain vector compared with its expectation under a belief.

    Parameters
    ----------
    residual : (C,) the strain minus its expectation
    spread : (C,) variance of the expected strain over the belief
    noise : (F,) variance of one visit, averaged over the belief
    """

    residual: np.ndarray
    spread: np.ndarray
    noise: np.ndarray
