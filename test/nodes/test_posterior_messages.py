"""Estimates as messages."""

from types import SimpleNamespace

import pytest

pytestmark = pytest.mark.ros


@pytest.mark.parametrize(
    ("converged", "stale", "state"),
    [
        (None, "", "UNKNOWN"),
        (False, "", "SEARCHING"),
        (True, "", "CONVERGED"),
        (True, "no strain", "STALE"),
        (False, "no strain", "STALE"),
    ],
)
def test_the_state_of_an_estimate(converged: bool | None, stale: str, state: str) -> None:
    from tactile_localizer.msg import Posterior
    from tactile_localizer.nodes.posterior_messages import state_of

    estimate = None if converged is None else SimpleNamespace(converged=converged)
    assert state_of(estimate, stale) == getattr(Posterior, state)  # type: ignore[arg-type]
