"""Recorded fabrics are evaluated as the command line would import and replay them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tactile_localizer.cli import main
from tactile_localizer.errors import ScanError
from tactile_localizer.io.recording import NO_CONTACT
from tactile_localizer.io.scans.store import ScanStore
from tactile_localizer.offline.evaluation.fabric import STARTS, TRAVEL, fabric_condition


def test_a_fabric_is_mapped_from_two_repeats_and_started_anywhere_on_the_third(data_dir: Path) -> None:
    condition = fabric_condition("linen", 1, data_dir / "fabric_slide")
    material = condition.load()
    assert len(material.recording.sweeps) == STARTS
    for sweep in material.recording.sweeps:
        assert np.ptp(sweep.truth) == pytest.approx(TRAVEL, abs=0.001)
        assert sweep.position[0] == 0.0
    assert all(sweep.contact == NO_CONTACT for sweep in material.recording.sweeps)
    assert condition.load().recording.sweeps[3].truth[0] == material.recording.sweeps[3].truth[0]
    another = fabric_condition("linen", 2, data_dir / "fabric_slide").load()
    assert another.recording.sweeps[3].truth[0] != material.recording.sweeps[3].truth[0]


def test_the_map_is_that_of_an_import_but_for_its_unit(data_dir: Path, tmp_path: Path) -> None:
    files = [str(data_dir / "fabric_slide" / f"Canvas_F250_V10mmps_{repeat}.csv") for repeat in (0, 1)]
    reading = ["--columns", "fabric_slide.yaml", "--speed", "0.01", "--scene", "canvas.yaml"]
    assert main(["import", "csv", *files, *reading, "-o", str(tmp_path / "scan.db")]) == 0
    with ScanStore.open(tmp_path / "scan.db") as store:
        imported = store.load()
    condition = fabric_condition("canvas", 1, data_dir / "fabric_slide")
    scale = np.median(condition.scan.strain.std(axis=0)) / np.median(imported.strain.std(axis=0))
    np.testing.assert_array_equal(condition.scan.states, imported.states)
    np.testing.assert_allclose(condition.scan.strain, scale * imported.strain)


def test_recordings_that_are_not_there_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ScanError, match=r"Linen_F250_V10mmps_0\.csv"):
        fabric_condition("linen", 1, tmp_path)
