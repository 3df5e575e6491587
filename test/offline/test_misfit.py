"""A recording that does not fit the map says so in one line, and what that usually means."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from support.tracks import made_track

from tactile_localizer.io.recording import RecordedSweep
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.io.status import MISSING
from tactile_localizer.offline.evaluation.conditions import recording_of
from tactile_localizer.offline.misfit import Misfit, misfit
from tactile_localizer.resources import resource_path
from tactile_localizer.sim import simulate_scan

SCENE = load_scene(resource_path("config/scenes/bump.yaml"))
SCAN = simulate_scan("bump", 1, rate=50.0).to_scan()
TEST = recording_of(simulate_scan("bump", 1, "test", sweeps=2, rate=50.0))


def found(change: Callable[[RecordedSweep], RecordedSweep], true_positions: bool = True) -> Misfit:
    """The misfit of test sweeps that were changed."""
    sweeps = tuple(change(replace(sweep, position=sweep.truth)) for sweep in TEST.sweeps)
    track = made_track(np.zeros((3, 2)), 0.001, None, consistent=np.ones((3, 2), dtype=bool))
    return misfit(SCAN, SCENE, replace(TEST, sweeps=sweeps), [track], true_positions)


def test_a_recording_that_fits_says_nothing() -> None:
    assert found(lambda sweep: sweep).line is None
    assert (
        found(lambda sweep: replace(sweep, position=sweep.position + 3.0), true_positions=False).line is None
    )


def test_blank_sweeps_fit() -> None:
    assert found(lambda sweep: sweep.part(slice(0, 20), sweep.number)).line is None


@pytest.mark.parametrize("true_positions", [True, False])
def test_positions_in_millimetres_are_named(true_positions: bool) -> None:
    line = found(lambda sweep: replace(sweep, position=1e3 * sweep.position), true_positions).line
    assert line is not None
    assert "% of the positions are out of the scene's bounds" in line
    assert "x in mm?" in line
    assert "\n" not in line


def test_strains_in_millivolts_are_named() -> None:
    line = found(lambda sweep: replace(sweep, strain=1e3 * sweep.strain)).line
    assert line is not None
    assert "100% of the strains out of the scan's range" in line
    assert "millivolts" in line


def test_strains_in_kilovolts_are_named() -> None:
    line = found(lambda sweep: replace(sweep, strain=1e-3 * sweep.strain)).line
    assert line is not None
    assert "too small" in line


def test_swapped_phalanges_are_named() -> None:
    line = found(lambda sweep: replace(sweep, strain=np.roll(sweep.strain, 8, axis=1))).line
    assert line is not None
    assert "phalanges swapped: middle, index in the columns of index, middle?" in line


def test_a_phalanx_that_is_left_out_is_named() -> None:
    def without_middle(sweep: RecordedSweep) -> RecordedSweep:
        status, strain = sweep.status.copy(), sweep.strain.copy()
        status[:, 1], strain[:, 8:] = MISSING, np.nan
        return replace(sweep, status=status, strain=strain)

    line = found(without_middle).line
    assert line is not None
    assert "left out: middle" in line
