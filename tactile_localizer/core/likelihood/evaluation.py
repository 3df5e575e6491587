"""What a strain says about every explanation of it: the value that filters and decisions take."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

if TYPE_CHECKING:
    from tactile_localizer.core.likelihood.new_session import NewSession

INFLATION = 9.0
"""Factor of the variance under which a strain fits unknown material: three standard deviations. By judgement;
tried on two fabrics and three simulated features."""


class Evaluation(NamedTuple):
    """Log-likelihoods of one strain, nats, under P hypotheses and under the alternatives to the map.

    All are densities over the same strains with the same noise, so they can be compared.

    Parameters
    ----------
    position : (P,) at each state of the map, for *where* on it the hand is
    same_material : (P,) at each state of the map, for *whether* the hand is on it; of the sweep mixture the
        same as ``position``
    other_material : (P,) at each state, with a larger variance: as at that place, but another material
    elsewhere : mean over all places of the map, with its variance and with a larger one
    featureless : of featureless material; ``-inf`` where the scanned material is felt everywhere
    nodes : (P,) of the map, nearest to the states
    """

    position: np.ndarray
    same_material: np.ndarray
    other_material: np.ndarray
    elsewhere: float
    featureless: float
    nodes: np.ndarray


class Expected(NamedTuple):
    """A strain compared with what a belief lets one expect, whitened.

    Parameters
    ----------
    residual : (C,) the strain less its expectation
    spread : (C,) variance of that expectation over the belief
    noise : (F,) variance of one visit, averaged over the belief
    """

    residual: np.ndarray
    spread: np.ndarray
    noise: np.ndarray


class StrainModel(Protocol):
    """Likelihoods of whitened strains at states of the map and under the alternatives to it.

    Attributes
    ----------
    information_length : m of travel that make one independent measurement of the position
    presence_length : m of travel that make one independent test of whether the map applies
    offset_variance : (C,) whitened variance of a sweep's constant offset
    new_session : how strains differ in another session, where that can only be told along a trajectory
    """

    information_length: float
    presence_length: float
    offset_variance: np.ndarray
    new_session: NewSession | None

    def whitened(self, strain: np.ndarray) -> np.ndarray:
        """A strain (C,), V, in the coordinates that :meth:`evaluate` takes."""

    def in_volts(self, difference: np.ndarray) -> np.ndarray:
        """A difference of whitened strains (C,), V."""

    def evaluate(
        self, states: np.ndarray, strain: np.ndarray, used: np.ndarray, offset_variance: np.ndarray
    ) -> Evaluation:
        """Log-likelihoods of a whitened ``strain`` (C,) at ``states`` (P, d).

        Parameters
        ----------
        used : (F,) bool, phalanges that count
        offset_variance : (F,) of what is not known of the sweep's offset, whitened
        """

    def expected(self, nodes: np.ndarray, log_weights: np.ndarray, strain: np.ndarray) -> Expected:
        """The strain (C,) compared with its expectation under ``log_weights`` (P,) of ``nodes`` (P,)."""
