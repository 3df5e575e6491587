"""Random processes of the simulation."""

import numpy as np
import pytest

from tactile_localizer.sim.noise import rough, smooth


@pytest.mark.parametrize("process", [rough, smooth])
@pytest.mark.parametrize("correlation", [0.3, 5.0, 60.0])
def test_noise_has_unit_variance_from_the_first_sample(process, correlation):
    noise = process(np.random.default_rng(1), 50, 4000, correlation)
    np.testing.assert_allclose(np.std(noise[[0, -1]], axis=1), 1, atol=0.06)


def test_correlation_length_is_as_given():
    noise = rough(np.random.default_rng(2), 2, 200_000, 1.0)
    assert np.mean(noise[0] * noise[1]) == pytest.approx(np.exp(-1), abs=0.02)
