"""Sweeps of a recording, and parts of them."""

import dataclasses

import numpy as np
import pytest

from tactile_localizer.io.recording import ENDED_EARLY, RecordedSweep, Recording, undelayed
from tactile_localizer.scene import Axis


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


def test_strain_that_is_late_gets_the_positions_where_it_was_felt():
    """Two sweeps that follow each other, and one of another run; the truth is taken along."""
    stamp_ns = 10_000_000 * np.arange(200)
    position = np.abs(100 - np.arange(200.0))[:, None] * 1e-3
    strain = np.roll(position, 7, axis=0)  # felt seven samples before
    samples = RecordedSweep(
        1,
        stamp_ns,
        position,
        strain,
        np.zeros((200, 1), np.uint8),
        truth=position + 1.0,
        felt=strain[:, 0] > 0,
    )
    sweeps = (
        samples.part(slice(0, 100), 1),
        samples.part(slice(100, 200), 2),
        samples.part(slice(0, 100), 3),
    )
    late = Recording("source", sweeps)
    found = undelayed(late, (Axis("x", -1.0, 1.0),), 0.07)
    assert [len(each) for each in found.sweeps] == [100, 93, 93]
    assert [each.gaps for each in found.sweeps] == [7, 0, 7]
    for each in found.sweeps:
        np.testing.assert_allclose(each.position, each.strain, atol=1e-12)
        np.testing.assert_allclose(each.truth, each.position + 1.0, atol=1e-12)
        np.testing.assert_array_equal(each.felt, each.strain[:, 0] > 0)
    np.testing.assert_array_equal(found.sweeps[0].stamp_ns, stamp_ns[:100])
    back = undelayed(found, (Axis("x", -1.0, 1.0),), -0.07)
    np.testing.assert_array_equal(back.sweeps[1].stamp_ns, sweeps[1].stamp_ns[:93])
