"""The benchmark of simulated features: scenes and totals."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import features
import pytest

from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.resources import resource_path

ROOT = Path(__file__).parents[2]


def test_scenes_give_no_parameters_and_the_region_only_where_asked() -> None:
    shipped = load_scene(resource_path("config/scenes/bump.yaml"))
    with_region, without = features.bare(shipped, region=True), features.bare(shipped, region=False)
    assert (with_region.measurement, without.measurement) == ({}, {})
    assert (with_region.feature, without.feature) == (shipped.feature, None)
    assert (without.axes, without.phalanges) == (shipped.axes, shipped.phalanges)


def test_counts_are_summed_and_other_measures_averaged() -> None:
    common = dict.fromkeys(features._COLUMNS, 0)
    rows = [
        {**common, "seed": 1, "feature": "bump", "sweeps": 2, "error_mm": 1.0, "false_blank": 1},
        {**common, "seed": 1, "feature": "snap", "sweeps": 2, "error_mm": 3.0, "false_blank": 0},
        {**common, "seed": 2, "feature": "bump", "sweeps": 2, "error_mm": 2.0, "false_blank": 2},
    ]
    found = {(one["over"], one.get(one["over"])): one for one in features.totals(rows)}
    assert (found["all", None]["error_mm"], found["all", None]["false_blank"]) == (2.0, 3)
    assert (found["feature", "bump"]["error_mm"], found["feature", "bump"]["sweeps"]) == (1.5, 4)
    assert (found["seed", 1]["error_mm"], found["seed", 2]["false_blank"]) == (2.0, 2)


@pytest.mark.slow
def test_every_seed_and_feature_has_a_row(tmp_path: Path) -> None:
    chosen = ["--seeds", "80", "--features", "bump", "--sweeps", "1", "--jobs", "1"]
    subprocess.run(
        [sys.executable, "benchmarks/features.py", *chosen, "--json", tmp_path / "rows.json"],
        check=True,
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        timeout=600,
    )
    document = json.loads((tmp_path / "rows.json").read_text())
    (row,) = document["rows"]
    assert (row["seed"], row["feature"], row["sweeps"]) == (80, "bump", 1)
    assert row["error_mm"] < 10.0
    assert row["false_blank"] == 0
    assert 0.0 <= row["seam_strains"] <= 1.0
    assert [one["over"] for one in document["totals"]] == ["all", "feature", "seed"]
