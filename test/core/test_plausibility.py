"""Stamps in a wrong unit, and load cells that repeat themselves to the last bit, are noticed."""

from typing import Any

import numpy as np
import pytest

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.plausibility import PhalanxConsistency, StampUnit
from tactile_localizer.errors import MeasurementError

POSITION = np.column_stack([np.linspace(0, 0.05, 500), np.zeros(500)])


def checked(period):
    unit = StampUnit()
    for row, position in enumerate(POSITION):
        unit.check(row * period, position)


@pytest.mark.parametrize("period", [0.0, 0.005, 5.0, 5_000])
def test_stamps_in_another_unit_are_refused(period):
    """In s, ms and µs, of a hand at 20 mm/s."""
    with pytest.raises(MeasurementError, match=r"expected ns, the palm travelled 1\d mm in .* ns .*in s"):
        checked(period)


def test_stamps_in_nanoseconds_are_accepted():
    unit = StampUnit()
    for row, position in enumerate(POSITION):
        jump, tremor = row > 200, 0.001 * (row % 2)  # of 1 m, and of 1 mm
        unit.check(row * 1_000_000, position + jump + tremor)
    unit.check(0, POSITION[0])


def test_a_stamp_that_is_no_number_is_refused():
    with pytest.raises(MeasurementError, match="stamp_ns: expected a whole number of ns, got None"):
        StampUnit().check(None, POSITION[0])


def observed(
    frozen: tuple[int, ...], steps: int = 10, present: tuple[bool, ...] = (True, True), travel: float = 0.0005
) -> PhalanxConsistency:
    """After ``steps`` strains, ``travel`` apart, of which those of the ``frozen`` phalanges never change."""
    consistency, rng = PhalanxConsistency(ChannelLayout((3, 3))), np.random.default_rng(0)
    for _ in range(steps):
        strain = rng.standard_normal(6)
        for phalanx in frozen:
            strain[3 * phalanx : 3 * phalanx + 3] = 0.123
        consistency.observe(strain, np.array(present), travel)
    return consistency


@pytest.mark.parametrize(
    ("frozen", "values", "consistent"),
    [
        ((1,), {}, [True, False]),
        ((1,), {"steps": 4}, [True, True]),
        ((0, 1), {}, [True, True]),
        ((1,), {"present": (True, False)}, [True, True]),
        ((1,), {"steps": 1000, "travel": 0.0}, [True, True]),
    ],
    ids=["stuck", "over less than 2 mm", "all: a replay, or featureless material", "absent", "at rest"],
)
def test_a_phalanx_that_repeats_itself_alone_over_two_millimetres_is_stuck(
    frozen: tuple[int, ...], values: dict[str, Any], consistent: list[bool]
) -> None:
    assert observed(frozen, **values).consistent.tolist() == consistent


def test_a_phalanx_that_changes_again_is_taken_back() -> None:
    consistency = observed((1,))
    consistency.observe(np.arange(6.0), np.ones(2, dtype=bool), 0.0005)
    assert consistency.consistent.all()
