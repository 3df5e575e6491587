"""Likelihoods of a strain vector on the map."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Likelihoods(NamedTuple):
    """Log-likelihoods of one strain vector on the map, nats.

    Parameters
    ----------
    states : (P,) at each state of the filter
    anchors : (R,) at each of the places that represent the whole map
    resembling : (F,) of each phalanx, on material that resembles the map where the hand was expected
    """

    states: np.ndarray
    anchors: np.ndarray
    resembling: np.ndarray
