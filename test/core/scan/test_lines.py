"""Lines of a scan: spacing, repetitions, differences of their strains."""

import numpy as np
import pytest
from support.scans import raster

from tactile_localizer.core.scan.lines import differences_between_lines, line_spacing
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.tracks import Tracks
from tactile_localizer.scene import Axis, Phalanx, Scene

SIDE, SPACING = 0.03, 0.003
PLANE = Scene("plane", (Axis("x", 0.0, SIDE), Axis("y", 0.0, SIDE)), (Phalanx("index", (0.0, 0.0), 2),))


def lines(step: float = 0.0003) -> Scan:
    """Lines along x, whose strains are their x and y in millimetres."""
    return raster(PLANE, lambda states, _: 1e3 * states, SPACING, 0.0, step)


def test_line_spacing() -> None:
    assert line_spacing(Tracks.of(lines(), PLANE)) == pytest.approx(SPACING)
    scan = lines()
    assert line_spacing(Tracks.of(scan.select(scan.sweep == 0), PLANE)) == 0.0


@pytest.mark.parametrize("passes", [2, 3])
def test_repeated_lines_do_not_reduce_the_spacing(passes: int) -> None:
    once, aside = Tracks.of(lines(), PLANE), np.array([0.0, 0.0001])
    positions = np.concatenate([once.positions + n * aside for n in range(passes)])
    tracks = Tracks(PLANE, positions, np.tile(once.strain, (passes, 1)), np.tile(once.counts, passes))
    assert line_spacing(tracks) == pytest.approx(SPACING, rel=0.1)


def test_strains_are_compared_at_neighbouring_places_of_two_lines() -> None:
    along, across = np.median(differences_between_lines(Tracks.of(lines(), PLANE)), axis=0)
    assert along == pytest.approx(0.0, abs=1e-9)
    assert across == pytest.approx(1e3 * SPACING)


def test_a_single_sweep_is_compared_with_itself_one_point_later() -> None:
    scan = lines()
    differences = differences_between_lines(Tracks.of(scan.select(scan.sweep == 0), PLANE))
    assert 0.0 < np.median(differences[:, 0]) < 1.0
