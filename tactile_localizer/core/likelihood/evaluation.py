"""Likelihoods of a strain under all hypotheses, and the interface of the models that compute them."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

if TYPE_CHECKING:
    from tactile_localizer.core.likelihood.new_session import NewSession

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


class StrainModel(Protocol):
    """Likelihoods of whitened strains at states of the map and under the alternatives to it.

    Attributes
    ----------
    information_length : m of travel per independent measurement of the position
    presence_length : m of travel per independent measurement of whether the hand is on the map
    offset_variance : (C,) whitened variance of a sweep's constant offset
    new_session : model of another session, where its offset has to be learned along trajectories
    """

    information_length: float
    presence_length: float
    offset_variance: np.ndarray
    new_session: NewSession | None

    def whitened(self, strain: np.ndarray) -> np.ndarray:
        """A strain vector (C,), V, in whitened coordinates."""

    def in_volts(self, difference: np.ndarray) -> np.ndarray:
        """A difference (C,) of whitened strains in V."""

    def evaluate(
        self, states: np.ndarray, strain: np.ndarray, used: np.ndarray, offset_variance: np.ndarray
    ) -> Evaluation:
        """Log-likelihoods of a whitened ``strain`` (C,) at ``states`` (P, d).

        Parameters
        ----------
        used : (F,) bool, phalanges that count
        offset_variance : (F,) whitened variance of the remaining uncertainty of the sweep's offset
        """

    def expected(self, nodes: np.ndarray, log_weights: np.ndarray, strain: np.ndarray) -> Expected:
        """Comparison of a whitened strain (C,) with that expected under ``log_weights`` of ``nodes`` (P,)."""
