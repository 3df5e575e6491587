"""The benchmark of recorded features, on a folder that the simulator writes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import recorded

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.io.scene_file import load_scene, save_scene
from tactile_localizer.resources import resource_path
from tactile_localizer.sim import simulate_scan
from tactile_localizer.sim.hand import PHALANGES
from tactile_localizer.sim.scan import SimulatedScan


def write_sweeps(path: Path, scan: SimulatedScan, every: int) -> None:
    """A file of true positions, of every so many-th sample."""
    channels = [f"{phalanx}_{number}" for phalanx in PHALANGES for number in range(1, 9)]
    rows = np.column_stack([1e-9 * scan.stamp_ns, scan.sweep, scan.truth, scan.strain, scan.felt])[::every]
    header = ",".join(["stamp_s", "sweep", "x", "y", *channels, "felt"])
    np.savetxt(path, rows, "%.9g", ",", header=header, comments="")


@pytest.mark.slow
def test_a_folder_has_a_row(tmp_path: Path) -> None:
    save_scene(load_scene(resource_path("config/scenes/bump.yaml")), tmp_path / "scene.yaml")
    write_sweeps(tmp_path / "train.csv.gz", simulate_scan("bump", 1), 4)
    write_sweeps(tmp_path / "test.csv", simulate_scan("bump", 1, "test", sweeps=1), 1)
    write_sweeps(tmp_path / "foreign_seam.csv", simulate_scan("seam", 1, "test", sweeps=1), 1)
    (row,) = recorded.measure_folder(tmp_path, recorded.Variant(lines=2), Configuration(), 1)
    assert row["error_settled_mm"] < 5.0
    assert row["false_before"] == 0
    assert row["foreign_sweeps"] in (0.0, 1.0)
    assert row["learned"]["information_length"] > 0.0
    assert "false_blank" not in row


def test_sweeps_over_one_line_share_its_number() -> None:
    means = np.array([[0.1, 0.0], [0.1001, 0.01], [0.1, 0.0201], [0.1, 0.0002], [0.1, 0.02]])
    assert recorded.line_numbers(means).tolist() == [0, 1, 2, 0, 2]
