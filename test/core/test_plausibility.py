"""Stamps in a wrong unit, and load cells that repeat themselves to the last bit, are noticed."""

from typing import Any

import numpy as np
import pytest
from support.scans import slides

from tactile_localizer.core.plausibility import StampUnit, StuckGauges, still_travel
from tactile_localizer.errors import MeasurementError
from tactile_localizer.scene import Axis, Phalanx, Scene

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
    frozen: tuple[int, ...],
    steps: int = 10,
    present: tuple[int, ...] = (0, 1, 2, 3),
    travel: float = 0.0005,
    longest: float = 0.0,
) -> StuckGauges:
    """After ``steps`` strains, ``travel`` apart, of which the ``frozen`` channels never change."""
    gauges, rng = StuckGauges(np.array([longest, longest, longest, np.inf])), np.random.default_rng(0)
    for _ in range(steps):
        strain = rng.standard_normal(4)
        strain[list(frozen)] = 0.123
        gauges.observe(strain, np.isin(np.arange(4), present), travel)
    return gauges


@pytest.mark.parametrize(
    ("frozen", "values", "stuck"),
    [
        ((1,), {}, [1]),
        ((0, 2), {}, [0, 2]),
        ((1,), {"steps": 4}, []),
        ((0, 1, 2, 3), {}, []),
        ((1,), {"present": (0, 2)}, []),
        ((1,), {"steps": 1000, "travel": 0.0}, []),
        ((1,), {"longest": 0.003}, []),
        ((3,), {"steps": 1000}, []),
    ],
    ids=[
        *("one", "two", "over less than 2 mm", "all: a replay, or featureless material", "absent", "at rest"),
        *("as coarse in the scan", "as dead in the scan"),
    ],
)
def test_a_gauge_that_repeats_itself_while_others_change_is_stuck(
    frozen: tuple[int, ...], values: dict[str, Any], stuck: list[int]
) -> None:
    assert np.flatnonzero(observed(frozen, **values).stuck).tolist() == stuck


def test_a_gauge_that_changes_again_is_taken_back() -> None:
    gauges = observed((1,))
    gauges.observe(np.arange(4.0), np.ones(4, dtype=bool), 0.0005)
    assert not gauges.stuck.any()


def test_of_a_scan_the_longest_travel_without_a_change_counts_within_a_sweep() -> None:
    of = Scene("line", (Axis("x", 0.0, 0.1),), (Phalanx("index", (0.0,), 3),))
    x = np.arange(0.0, 0.01, 0.001)
    coarse, fine = np.floor(x / 0.004 + 1e-9), np.arange(10.0)
    scan = slides(of, x, [np.column_stack([coarse, fine, np.full(10, 7.0)]) for _ in range(2)])
    np.testing.assert_allclose(still_travel(scan, of), [0.004, 0.001, np.inf])
