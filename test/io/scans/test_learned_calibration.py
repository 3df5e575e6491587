"""Calibrations are computed once and stored in the scan file."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from support.sweeps import write_scan

from tactile_localizer.core.calibration.held_out import Calibration
from tactile_localizer.core.likelihood.strain_map import VarianceModel
from tactile_localizer.core.scan.digest import digest_of
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.io.scans import learned as module
from tactile_localizer.io.scans.learned import KEY, find_calibration, learned_calibration, store_learned
from tactile_localizer.io.scans.rows import LearnedEntry
from tactile_localizer.io.scans.store import ScanStore
from tactile_localizer.scene import Scene


@pytest.fixture
def calibrated(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the calibrated scenes; replaces a calibration that takes seconds."""
    names: list[str] = []

    def learn(_scan: Scan, scene: Scene, _progress: object) -> Calibration:
        names.append(scene.name)
        return Calibration(0.0015, np.full(scene.dimension, 0.0004), VarianceModel(0.7, 0.1, 0.4, 0.005))

    monkeypatch.setattr(module, "learn", learn)
    return names


@pytest.fixture
def path(tmp_path: Path) -> Path:
    write_scan(tmp_path / "scan.db", calibrated=False)
    return tmp_path / "scan.db"


def loaded(path: Path) -> tuple[Scan, Scene]:
    with ScanStore.open(path) as store:
        return store.load(), store.scene


def test_a_scan_is_calibrated_once(path: Path, calibrated: list[str]) -> None:
    first, second = (learned_calibration(path, *loaded(path)) for _ in range(2))
    assert first.information_length == second.information_length == 0.0015
    np.testing.assert_array_equal(first.registration_std, second.registration_std)
    assert second.variance == VarianceModel(0.7, 0.1, 0.4, 0.005)
    assert calibrated == ["bump"]


def test_another_scene_is_calibrated_again(path: Path, calibrated: list[str]) -> None:
    scan, scene = loaded(path)
    learned_calibration(path, scan, scene)
    learned_calibration(path, scan, dataclasses.replace(scene, feature=None))
    assert len(calibrated) == 2


def test_an_unwritable_file_is_calibrated_each_time(path: Path, calibrated: list[str]) -> None:
    missing = path.with_name("none.db")
    for _ in range(2):
        learned_calibration(missing, *loaded(path))
    assert len(calibrated) == 2


@pytest.mark.parametrize(
    "payload", [b"{}", b"[1]", b"x", b'{"information_length": 1, "registration_std": [1, 2, 3, 4]}']
)
def test_an_invalid_payload_is_calibrated_again(path: Path, calibrated: list[str], payload: bytes) -> None:
    scan, scene = loaded(path)
    store_learned(path, LearnedEntry(KEY, digest_of(scan, scene), payload))
    assert learned_calibration(path, scan, scene).information_length == 0.0015
    assert len(calibrated) == 1


def test_calibrated_scans_of_tests_are_not_calibrated_again(tmp_path: Path, calibrated: list[str]) -> None:
    write_scan(tmp_path / "calibrated.db")
    assert find_calibration(tmp_path / "calibrated.db", *loaded(tmp_path / "calibrated.db"))[1] is None
    assert calibrated == []
