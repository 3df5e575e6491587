"""A hand that slides in another direction than that of the scan: friction turns with it."""

from itertools import pairwise

import numpy as np
import pytest

from tactile_localizer.core.calibration.calibration import Calibration
from tactile_localizer.core.calibration.examination import Examination
from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.core.hypotheses.convergence import State
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.core.localizer import Localizer
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.io.recording import Recording, scan_of
from tactile_localizer.sim import shipped_scene, simulate_scan, simulate_sweep
from tactile_localizer.sim.scan import TRAINING_SWEEPS, sweep_plan

NEAR, FAR = (0.004, 0.0381), (0.048, 0.0381)
"""Ends of a stroke along x on which a finger meets the bump."""


SCENE = shipped_scene("bump")


def on(scan: Scan) -> Localizer:
    """A localizer on a scan of a sheet."""
    known = Calibration(np.full(2, 1e-3), Material.SHEET, examination=Examination(0.003, 0.003))
    return build_localizer(scan, SCENE, Configuration(), np.random.default_rng(0), calibration=known)


@pytest.fixture(scope="module")
def localizer() -> Localizer:
    """On a bump that was scanned towards +x."""
    return on(simulate_scan("bump", 1, rate=50.0))


def states(localizer: Localizer, *ends: tuple[float, float]) -> list[State]:
    """State after each strain of one sweep, which goes straight from each of the ``ends`` to the next."""
    localizer.reset()
    stamp, found = 0, []
    for number, (start, end) in enumerate(pairwise(ends)):
        stroke = simulate_sweep("bump", 2, number, start=start, end=end, rate=50.0)
        assert stroke.truth is not None
        for place, strain in zip(stroke.truth, stroke.strain, strict=True):
            stamp += 20_000_000
            found.append(localizer.update(stamp, place, strain).state)
    return found


def test_a_hand_that_slides_as_the_scan_did_converges(localizer: Localizer) -> None:
    assert states(localizer, NEAR, FAR)[-1] is State.CONVERGED


def test_the_opposite_direction_is_other_material(localizer: Localizer) -> None:
    found = states(localizer, FAR, NEAR)
    assert State.CONVERGED not in found
    assert found[-1] is State.UNKNOWN


def test_a_hand_that_turns_round_is_lost(localizer: Localizer) -> None:
    there, back = len(states(localizer, NEAR, FAR)), states(localizer, NEAR, FAR, NEAR)
    assert back[there - 1] is State.CONVERGED
    assert State.LOST in back[there : there + 100]
    assert back[-1] is not State.CONVERGED


def test_each_line_scanned_both_ways_is_a_map_of_both() -> None:
    strokes = []
    for number in range(2 * TRAINING_SWEEPS):  # an odd number of lines: the second round is the other way
        start, end = sweep_plan("train", number, 1)
        there = (start, end) if number % 2 else (end, start)
        strokes.append(simulate_sweep("bump", 1, number, "train", start=there[0], end=there[1], rate=50.0))
    both_ways = on(scan_of(Recording("bump", tuple(strokes)), SCENE))
    assert State.CONVERGED in states(both_ways, NEAR, FAR)
    assert State.CONVERGED in states(both_ways, FAR, NEAR)
