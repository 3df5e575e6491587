"""What is known along the trajectories of a belief follows them."""

import numpy as np
import pytest

from tactile_localizer.core import compiled
from tactile_localizer.core.likelihood.ancestry import Ancestry
from tactile_localizer.core.likelihood.drift import Drift
from tactile_localizer.core.likelihood.gain import Gain

VALUES = np.arange(12, dtype=np.float32).reshape(2, 3, 2)


@pytest.fixture(autouse=True, params=["compiled", "numpy"])
def _either(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if request.param == "numpy":
        monkeypatch.setattr(compiled, "MODULE", None)


def test_each_trajectory_keeps_what_is_known_along_its_ancestor() -> None:
    ancestors = np.array([2, 2, 0, 1])
    found = Ancestry(ancestors, np.ones(4), np.zeros(0), np.array([0.5, 0.3, 0.2])).followed(VALUES)
    np.testing.assert_array_equal(found, VALUES[:, ancestors])


def test_what_came_from_anywhere_was_where_the_states_were() -> None:
    """Whatever is known along a trajectory, of which nothing is left."""
    values = VALUES.copy()
    values[:, 2] = 1e9
    found = Ancestry(np.array([0]), np.array([0.75]), np.ones(1), np.array([0.3, 0.7])).followed(values)
    mean = 0.3 * values[:, 0] + 0.7 * values[:, 1]
    np.testing.assert_allclose(found[:, 0], 0.75 * values[:, 0] + 0.25 * mean, rtol=1e-6)
    np.testing.assert_allclose(found[:, 1], mean, rtol=1e-6)


def test_trend_and_gain_follow_alike() -> None:
    ancestry = Ancestry(np.array([1, 0]), np.array([0.5, 1.0]), np.zeros(0), np.array([1.0, 0.0]))
    level, strain = Drift(np.inf, 1.0, np.ones(2)), np.array([[0, 0], [8, 8]], np.float32)
    _, trend = level.update(level.start(2), np.zeros(2), strain, 0.001, 1.0)
    np.testing.assert_allclose(trend.followed(ancestry).of_map[0, :, 0], [2.0, 0.0])
    gain = Gain(np.array([[[1.0, 2.0], [3.0, 4.0]], [[0.1, 0.2], [0.3, 0.4]]], dtype=np.float32))
    found = gain.followed(ancestry)
    np.testing.assert_allclose(found.mean, [[1.5, 1.0], [3.5, 3.0]])
    np.testing.assert_allclose(found.variance, [[0.15, 0.1], [0.35, 0.3]], rtol=1e-6)
