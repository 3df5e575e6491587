"""The number of neighbours, by the density of held-out strains."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from tactile_localizer.core.calibration.neighbours import (
    NEIGHBOURS,
    NeighbourTrial,
    search_neighbours,
)
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import ScanError
from tactile_localizer.scene import Axis, Phalanx, Region, Scene

SCENE = Scene("line", (Axis("x", 0.0, 0.06, 0.002),), (Phalanx("index", (0.0,)),))


def lines(noise: float, sweeps: int = 3, pairs: int = 100) -> Scan:
    """Sweeps along one axis over a smooth random pattern of 1 V, with the same noise in each."""
    rng = np.random.default_rng(0)
    x = np.tile(np.linspace(0.0, 0.06, pairs), sweeps)
    phases, waves = rng.uniform(0, 6, 8), rng.uniform(200, 500, 8)
    strain = np.sin(x[:, None] * waves + phases) + noise * rng.standard_normal((len(x), 8))
    return Scan(x[:, None], strain, np.repeat(np.arange(sweeps), pairs), ("x",), ("index",))


@cache
def tried(noise: float) -> tuple[NeighbourTrial, ...]:
    return tuple(search_neighbours(lines(noise), SCENE))


def best(trials: tuple[NeighbourTrial, ...]) -> NeighbourTrial:
    return max(trials, key=lambda trial: trial.score)


def test_every_number_is_tried() -> None:
    trials = tried(0.02)
    assert [trial.neighbours for trial in trials] == list(NEIGHBOURS)
    assert all(0.0 < trial.shrinkage <= 1.0 for trial in trials)


def test_noisier_scans_need_more_neighbours() -> None:
    assert best(tried(1.0)).neighbours > best(tried(0.02)).neighbours


def test_neighbours_are_in_other_sweeps() -> None:
    """Sweeps with different offsets are explained only by themselves."""
    scan = lines(0.02)
    own = np.random.default_rng(1).normal(0.0, 3.0, (3, 8))[scan.sweep]
    apart = Scan(scan.states, scan.strain + own, scan.sweep, scan.axes, scan.phalanges)
    seen: list[float] = []
    found = search_neighbours(apart, SCENE, lambda _, done: seen.append(done))
    assert best(tuple(found)).score < best(tried(0.02)).score - 10.0
    assert (seen[0], seen[-1]) == (0.0, 1.0)


def test_a_scan_without_pairs_on_the_feature_is_refused() -> None:
    elsewhere = Scene("line", SCENE.axes, SCENE.phalanges, Region((0.5,), (0.6,)))
    with pytest.raises(ScanError, match="expected pairs in the feature region of scene line, found none"):
        search_neighbours(lines(0.1), elsewhere)
