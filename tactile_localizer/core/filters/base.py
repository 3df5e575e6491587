"""The predicted belief, as a filter hands it to a measurement model."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Prior(NamedTuple):
    """The predicted belief: what a measurement model is evaluated at.

    Parameters
    ----------
    states : (P, d) hypotheses, m (yaw: rad)
    log_weights : (P, K) of each hypothesis and component, normalised
    memory : (P, K, C) what each hypothesis remembers
    """

    states: np.ndarray
    log_weights: np.ndarray
    memory: np.ndarray
