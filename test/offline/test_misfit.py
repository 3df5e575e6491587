"""Detection of recordings that do not fit the map."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from simulated import recording_of
from support.tracks import made_track

from tactile_localizer.io.recording import RecordedSweep
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.io.status import MISSING
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


def test_a_fitting_recording_has_no_misfit() -> None:
    assert found(lambda sweep: sweep).line is None
    moved = found(lambda sweep: replace(sweep, position=sweep.position + 3.0), true_positions=False)
    assert moved.line is None


def test_blank_sweeps_fit() -> None:
    assert found(lambda sweep: sweep.part(slice(0, 20), sweep.number)).line is None


@pytest.mark.parametrize("true_positions", [True, False])
def test_positions_in_millimetres_are_detected(true_positions: bool) -> None:
    misfit = found(lambda sweep: replace(sweep, position=1e3 * sweep.position), true_positions)
    assert misfit.outside > 0.5
    assert "x in mm?" in misfit.hints
    assert misfit.line is not None
    assert "\n" not in misfit.line


@pytest.mark.parametrize(("factor", "hint"), [(1e3, "millivolts"), (1e-3, "too small")])
def test_strains_of_another_unit_are_detected(factor: float, hint: str) -> None:
    misfit = found(lambda sweep: replace(sweep, strain=factor * sweep.strain))
    assert any(hint in text for text in misfit.hints)


def test_millivolts_exceed_the_range_of_the_scan() -> None:
    assert found(lambda sweep: replace(sweep, strain=1e3 * sweep.strain)).beyond == 1.0


def test_swapped_phalanges_are_detected() -> None:
    (hint,) = found(lambda sweep: replace(sweep, strain=np.roll(sweep.strain, 8, axis=1))).hints
    assert "swapped: middle, index" in hint


def test_an_unused_phalanx_is_named() -> None:
    def without_middle(sweep: RecordedSweep) -> RecordedSweep:
        status, strain = sweep.status.copy(), sweep.strain.copy()
        status[:, 1], strain[:, 8:] = MISSING, np.nan
        return replace(sweep, status=status, strain=strain)

    assert found(without_middle).left_out == ("middle",)
