"""Sweeps of a recording, and parts of them."""

import dataclasses

import numpy as np
import pytest

from tactile_localizer.io.recording import ENDED_EARLY, RecordedSweep


@pytest.mark.parametrize("rows", [slice(1, 3), np.array([False, True, True, False])])
def test_a_part_has_its_rows_of_every_array_and_the_rest_of_the_sweep(rows) -> None:
    rng = np.random.default_rng(0)
    arrays = {
        field.name: rng.random((4, 2))
        for field in dataclasses.fields(RecordedSweep)
        if "ndarray" in str(field.type)
    }
    part = RecordedSweep(3, **arrays, gaps=5, skipped=7, ending=ENDED_EARLY, strain_unit="N").part(rows, 8, 1)
    assert {*arrays} >= {"stamp_ns", "position", "strain", "status", "truth", "felt"}
    for name, values in arrays.items():
        np.testing.assert_array_equal(getattr(part, name), values[1:3])
    assert (part.number, part.gaps, part.skipped) == (8, 1, 7)
    assert (part.ending, part.strain_unit) == (ENDED_EARLY, "N")


def test_a_part_of_what_is_not_known_is_not_known() -> None:
    whole = RecordedSweep(1, np.arange(4), *(np.zeros((4, 2)) for _ in range(3)))
    assert (whole.part(slice(2), 2).truth, whole.part(slice(2), 2).felt) == (None, None)
