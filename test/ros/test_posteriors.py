"""Conversion of estimates to messages."""

from types import SimpleNamespace

import pytest

from tactile_localizer.core.hypotheses.convergence import State

pytestmark = pytest.mark.ros


@pytest.mark.parametrize("state", State)
@pytest.mark.parametrize("stale", ["", "no strain"])
def test_a_stale_estimate_has_the_state_stale(state: State, stale: str) -> None:
    from tactile_localizer.msg import Posterior
    from tactile_localizer.ros.publishers.estimates import state_of

    expected = "STALE" if stale else state.name
    assert state_of(SimpleNamespace(state=state), stale) == getattr(Posterior, expected)  # type: ignore[arg-type]
