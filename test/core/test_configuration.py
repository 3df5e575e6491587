"""The configuration is checked by name, kind and range."""

from typing import Any

import pytest

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.errors import ParameterError


def test_defaults_of_an_empty_mapping() -> None:
    assert Configuration.from_mapping({}) == Configuration()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"partcles": 5}, "did you mean particles"),
        ({"model": "gausian"}, "model 'gausian': expected sweep_mixture or module:Class"),
        ({"filter": "kalman"}, "filter 'kalman': expected one of grid, particle"),
        ({"particles": 7.5}, "particles: expected a whole number, got 7.5"),
        ({"particles": "many"}, "particles: expected int, got 'many'"),
        ({"particles": 0}, r"particles: expected 1 to 1e\+06, got 0"),
        ({"update_distance": 0.0}, "update_distance: expected 1e-06 to 1, got 0.0"),
        ({"update_distance": float("nan")}, "update_distance"),
        ({"convergence_travel": -1.0}, "convergence_travel: expected 0 to 1, got -1.0"),
        ({"convergence_probability": 1.0}, "convergence_probability: expected 0.5 to 1, got 1.0"),
        ({"random_particles": 10}, "random_particles: expected 0 with filter grid, got 10"),
    ],
)
def test_an_invalid_choice_is_refused(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        Configuration.from_mapping(values)
