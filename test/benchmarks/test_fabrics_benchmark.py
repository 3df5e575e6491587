"""The benchmark of recorded fabrics: pairs of recordings, perturbations, measures."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import fabric_recordings as recordings
import fabrics
import numpy as np
import pytest

ROOT = Path(__file__).parents[2]


def write_fabric(folder: Path, name: str, speed: int, material: int, repeats: int = 3) -> None:
    """A smooth random material of 100 mm, sampled each millimetre; repeats differ by white noise."""
    for repeat in range(repeats):
        x = np.arange(0.0, 101.0)
        waves = np.random.default_rng(material).normal(size=(16, 40, 2))
        phase = 2 * np.pi * x[:, None] / np.geomspace(6.0, 200.0, 40)
        felt = np.einsum("cw,xw->xc", waves[..., 0], np.sin(phase)) * 5
        felt += np.einsum("cw,xw->xc", waves[..., 1], np.cos(phase)) * 5
        felt += np.random.default_rng([material, repeat]).normal(size=felt.shape)
        stamp_ms = np.round(1000 + x / abs(speed) * 1e3)
        header = ["timestamp", "proximity1", "proximity2", *(f"channel{n}" for n in range(1, 17))]
        rows = np.column_stack([stamp_ms, 0 * x, 0 * x, np.round(felt)]).astype(int)
        lines = [", ".join(header), *(",".join(map(str, row)) for row in rows)]
        (folder / f"{name}_V{speed}mmps_{repeat}.csv").write_text("\n".join(lines) + "\n")


def test_recordings_are_paired_by_what_differs(tmp_path: Path) -> None:
    conditions = ("Linen_F250_V10", "Linen_F250_V20", "Linen_F250_V-10", "Linen_F210_V10", "Silk_F250_V20")
    for name in (*conditions, "notes"):
        for repeat in range(3):
            (tmp_path / f"{name}mmps_{repeat}.csv").touch()
    (tmp_path / "Board_F150_V-10mmps_0.csv").touch()
    pairs = recordings.find_pairs(recordings.find_conditions(tmp_path))
    of_map = {(one.recording.name, one.kind) for one in pairs if one.map.name == "Linen_F250_V10"}
    assert of_map == {
        ("Linen_F250_V10", "own"),
        ("Linen_F250_V20", "speed"),
        ("Linen_F210_V10", "force"),
        ("Silk_F250_V20", "wrong"),
        ("Board_F150_V-10", "wrong"),
    }
    on_silk = [one.recording.name for one in pairs if one.map.name == "Silk_F250_V20"]
    assert sorted(on_silk) == ["Board_F150_V-10", "Linen_F250_V20", "Silk_F250_V20"]
    assert {one.map.name for one in pairs} == set(conditions)


def test_the_position_is_the_speed_times_the_time(tmp_path: Path) -> None:
    write_fabric(tmp_path, "Linen_F250", -50, material=1)
    (condition,) = recordings.find_conditions(tmp_path)
    fabric = recordings.load_map(condition, scale=2.0)
    assert fabric.length == pytest.approx(0.1)
    assert fabric.scene.upper == pytest.approx(0.1)
    assert fabric.scene.measurement == {}
    assert fabric.scene.feature is None
    np.testing.assert_allclose(np.diff(fabric.scan.states[:100, 0]), 0.001)
    np.testing.assert_allclose(fabric.noise_width, np.sqrt(2), rtol=0.3)


def test_a_recording_is_perturbed() -> None:
    sweep = recordings.Sweep(
        np.arange(5) * 100_000_000, np.linspace(0.0, 0.04, 5), np.outer(np.arange(5.0), np.ones(16))
    )
    width = np.arange(1.0, 17.0)

    def perturbed(**how: Any) -> Any:
        return recordings.Perturbation(**how).of(sweep, width)

    np.testing.assert_allclose(perturbed(every=2).position, [0.0, 0.02, 0.04])
    assert perturbed(speed=2.0).stamp_ns.tolist() == [0, 50_000_000, 100_000_000, 150_000_000, 200_000_000]
    finer = perturbed(resample_hz=20.0)
    np.testing.assert_allclose(finer.strain[:, 0], np.arange(0.0, 4.1, 0.5))
    np.testing.assert_allclose(finer.position, np.linspace(0.0, 0.04, 9))
    offset = perturbed(offset=10.0, scale=1e3).strain - 1e3 * sweep.strain
    np.testing.assert_allclose(np.abs(offset), np.tile(1e4 * width, (5, 1)))


def test_the_measures_are_what_the_docstring_says() -> None:
    travel = np.array([0.0, 0.05, 0.1, 0.165])
    right = fabrics.Track(
        travel,
        error=np.array([0.2, 0.001, 0.003, 0.001]),
        covered=np.array([True, True, False, True]),
        converged=np.array([False, True, True, True]),
        update_s=np.array([1e-4]),
    )
    false = fabrics.Track(
        travel,
        error=np.array([0.2, 0.02, 0.02, 0.001]),
        covered=np.array([True, False, False, True]),
        converged=np.array([False, False, True, False]),
        update_s=np.array([1e-4]),
    )
    found = fabrics.measures([right, false], wrong=False)
    assert found == pytest.approx(
        {
            "found": 1.0,
            "error_80_mm": 11.5,
            "error_160_mm": 1.0,
            "converged_right_end": 0.5,
            "converged_false_end": 0.0,
            "converged_false_starts": 0.5,
            "converged_false_strains": 1 / 8,
            "coverage": 2 / 4,
            "coverage_40_mm": 3 / 6,
            "travel_to_convergence_mm": 75.0,
        }
    )
    never = fabrics.measures([false, false, right], wrong=False)["travel_to_convergence_mm"]
    assert never == pytest.approx(100.0)


def test_a_total_is_over_all_rows_of_a_kind_and_names_the_worst() -> None:
    rows = [
        {"kind": "own", "found": 1.0, "coverage": 0.95, "travel_to_convergence_mm": 3.0},
        {"kind": "own", "found": 0.9, "coverage": 0.80, "travel_to_convergence_mm": None},
        {"kind": "own", "found": 1.0, "coverage": 1.00, "travel_to_convergence_mm": 5.0},
    ]
    every, worst = fabrics.totals(rows)
    assert every["found"] == pytest.approx(2.9 / 3)
    assert every["travel_to_convergence_mm"] == 5.0
    assert (worst["found"], worst["coverage"]) == (0.9, 0.8)
    assert worst["travel_to_convergence_mm"] is None


class Oracle:
    """Knows where it is from its first channel, converged from 10 mm of travel after each jump on."""

    def __init__(self) -> None:
        self.resets = 0

    def reset(self) -> None:
        self.resets += 1
        self.last, self.since = -1.0, 0.0

    def update(self, stamp_ns: int, position: np.ndarray, strain: np.ndarray) -> Any:
        step = abs(strain[0] - self.last)
        self.since = self.since + step if step < 0.01 else 0.0
        self.last = strain[0]
        converged = self.since >= 0.01
        return SimpleNamespace(mean=strain[:1], covariance=np.diag([1e-6]), converged=converged, updated=True)


@pytest.fixture
def sweep() -> Any:
    position = np.arange(0.0, 0.6, 0.001)
    return recordings.Sweep(np.arange(600) * 100_000_000, position, np.repeat(position[:, None], 16, axis=1))


def test_starts_are_spaced_evenly_and_each_is_localized_anew(sweep: Any) -> None:
    starts, travel = fabrics.starts_of(sweep, 0.565, 5)
    np.testing.assert_allclose(starts, [0.0, 0.1, 0.2, 0.3, 0.4])
    assert travel == 0.165
    oracle = Oracle()
    tracks = fabrics.from_all_starts(oracle, sweep, 0.565, 5, wrong=False)
    assert oracle.resets == 5
    found = fabrics.measures(tracks, wrong=False)
    assert (found["found"], found["converged_right_end"], found["coverage"]) == (1.0, 1.0, 1.0)
    assert found["travel_to_convergence_mm"] == pytest.approx(10.0)
    assert fabrics.starts_of(sweep, 0.1, 2)[1] == 0.05


def test_on_a_wrong_fabric_whatever_converges_is_false(sweep: Any) -> None:
    tracks = fabrics.from_all_starts(Oracle(), sweep, 0.565, 5, wrong=True)
    found = fabrics.measures(tracks, wrong=True)
    assert (found["converged_false_starts"], found["converged_false_end"]) == (1.0, 1.0)
    assert found["converged_false_strains"] == pytest.approx(155 / 165, abs=0.01)
    assert found["found"] is None


def test_a_kidnapped_hand_is_to_converge_again(sweep: Any) -> None:
    found = fabrics.kidnapped(Oracle(), sweep, 0.565, 5)
    assert found == pytest.approx(
        {"right_before": 1.0, "again_40_mm": 1.0, "travel_again_mm": 10.0, "false_40_mm": 0.0}
    )


@pytest.mark.slow
def test_every_pair_has_a_row(tmp_path: Path) -> None:
    write_fabric(tmp_path, "Linen_F250", 50, material=1)
    write_fabric(tmp_path, "Silk_F250", 50, material=2, repeats=1)
    command = [sys.executable, "benchmarks/fabrics.py", tmp_path, "--starts", "2", "--jobs", "1"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    subprocess.run(
        [*command, "--json", tmp_path / "rows.json"], check=True, cwd=ROOT, env=environment, timeout=600
    )
    document = json.loads((tmp_path / "rows.json").read_text())
    own, wrong = document["rows"]
    assert (own["map"], own["recording"], own["kind"]) == ("Linen_F250_V50", "Linen_F250_V50", "own")
    assert (wrong["recording"], wrong["kind"]) == ("Silk_F250_V50", "wrong")
    assert own["found"] == 1.0
    assert own["error_80_mm"] is None  # of 100 mm half is travelled from each start
    assert wrong["found"] is None
    assert own["update_us"] > 0.0
    assert [row["kind"] for row in document["totals"]] == ["own", "own", "wrong", "wrong"]
