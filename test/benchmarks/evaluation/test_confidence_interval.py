"""Confidence intervals by resampling."""

from __future__ import annotations

import numpy as np
from evaluation.confidence_interval import mean_interval


def test_an_interval_covers_the_mean_as_often_as_its_level() -> None:
    rng = np.random.default_rng(0)
    intervals = [mean_interval(rng.normal(1.0, 2.0, 60)) for _ in range(200)]
    covered = np.mean([i.low <= 1.0 <= i.high for i in intervals])
    assert 0.89 <= covered <= 0.99
    assert mean_interval(np.array([np.nan, np.nan])) is None
