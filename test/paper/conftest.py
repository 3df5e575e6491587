"""What the tests of other models of the position have in common."""

import pytest

from tactile_localizer.core import factory
from tactile_localizer.core.calibration.examination import UNEXAMINED


@pytest.fixture(autouse=True)
def unexamined(monkeypatch: pytest.MonkeyPatch) -> None:
    """A model is not examined by held-out sweeps, which takes seconds (`test/core/calibration` does)."""
    monkeypatch.setattr(factory, "examine_position", lambda *_: UNEXAMINED)
