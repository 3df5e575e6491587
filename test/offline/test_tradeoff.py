"""The trade-off: candidates on recordings, the Pareto front, the choice."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from simulated import recording_of

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import ParameterError
from tactile_localizer.io.recording import Recording
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.offline.tradeoff import (
    Candidate,
    Outcome,
    Trade,
    candidates,
    for_target,
    pareto_front,
    trade,
    within_budget,
)
from tactile_localizer.resources import resource_path
from tactile_localizer.sim import simulate_scan

COARSE = [
    Candidate("coarse", Configuration(cell=1.0, update_distance=0.003)),
    Candidate("particles", Configuration(filter="particle", particles=75, update_distance=0.003)),
]


def trade_of(error: float, update_us: float, us_per_mm: float, name: str = "") -> Trade:
    timing = {"update_median_us": update_us, "update_p99_us": update_us, "us_per_mm": us_per_mm}
    along = np.zeros(1)
    outcome = Outcome(np.array([error]), np.ones(1), np.ones(1, dtype=bool), along, along, timing)
    return Trade(Candidate(name, Configuration()), (outcome,))


def test_the_front_has_what_no_other_beats_in_error_and_time() -> None:
    trades = [trade_of(2.0, 9, 300), trade_of(3.0, 9, 100), trade_of(2.5, 9, 400), trade_of(3.5, 9, 200)]
    assert [one.us_per_mm for one in pareto_front(trades)] == [100, 300]


def test_the_choice_is_the_most_accurate_in_the_budget_or_the_fastest_on_target() -> None:
    trades = [trade_of(0.002, 300, 600), trade_of(0.003, 200, 100), trade_of(0.0025, 250, 300)]
    assert within_budget(trades, 260) is trades[2]
    assert for_target(trades, 0.0028) is trades[2]
    assert within_budget(trades, 100) is None
    assert for_target(trades, 0.001) is None


def test_candidates_are_distinct_and_name_their_changes() -> None:
    found = candidates()
    assert len({one.configuration for one in found}) == len(found) == len({one.name for one in found})
    assert found[0].changes == {}
    assert Configuration(**found[-1].changes) == found[-1].configuration


@pytest.fixture(scope="module")
def bump() -> tuple[Scan, Recording]:
    scan = simulate_scan("bump", 1, sweeps=11).to_scan()
    return scan, recording_of(simulate_scan("bump", 1, "test", sweeps=2))


@pytest.mark.slow
def test_a_cluster_of_two_workers_finds_the_same(bump: tuple[Scan, Recording], tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed", reason="dask[distributed] is not installed")
    scan, recording = bump
    scene = load_scene(resource_path("config/scenes/bump.yaml"))
    here = trade(scan, scene, [recording], COARSE)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, local_directory=tmp_path
    ) as cluster:
        there = trade(scan, scene, [recording], COARSE, cluster=cluster.scheduler_address)
    for one, other in zip(here, there, strict=True):
        assert one.error == other.error < 0.01
        np.testing.assert_array_equal(one.outcomes[0].trace_along, other.outcomes[0].trace_along)


def test_what_cannot_be_measured_is_refused(bump: tuple[Scan, Recording]) -> None:
    scan, recording = bump
    scene = load_scene(resource_path("config/scenes/bump.yaml"))
    unknown = replace(recording, sweeps=(replace(recording.sweeps[0], truth=None),))
    with pytest.raises(ParameterError, match="simulated bump: expected true positions, found none"):
        trade(scan, scene, [unknown], COARSE)
    with pytest.raises(ParameterError, match="jobs: expected at least 1, or -1 for one per core, got 0"):
        trade(scan, scene, [recording], COARSE, jobs=0)
    with pytest.raises(ParameterError, match=r"--cluster tcp://127.0.0.1:9: expected a dask scheduler"):
        trade(scan, scene, [recording], COARSE, cluster="tcp://127.0.0.1:9")
