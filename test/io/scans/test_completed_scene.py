"""The completed scene is computed once and cached in the scan file."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
from support.sweeps import scene_of, write_scan

from tactile_localizer.cli import main
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.io.scans import learned as module
from tactile_localizer.io.scans.learned import completed_scene
from tactile_localizer.io.scans.store import ScanStore
from tactile_localizer.scene import Scene


@pytest.fixture
def chosen(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the scenes that were completed; instead of a choice that takes seconds."""
    names: list[str] = []

    def completed(scan: Scan, scene: Scene, progress: object) -> Scene:
        names.append(scene.name)
        return dataclasses.replace(scene, measurement=dict(scene_of().measurement))

    monkeypatch.setattr(module, "completed", completed)
    return names


@pytest.fixture
def path(tmp_path: Path) -> Path:
    write_scan(tmp_path / "scan.db", scene=dataclasses.replace(scene_of(), measurement={}))
    return tmp_path / "scan.db"


def loaded(path: Path) -> tuple[Scan, Scene]:
    with ScanStore.open(path) as store:
        return store.load(), store.scene


def test_completed_scene_is_computed_once(path: Path, chosen: list[str]) -> None:
    first, second = (completed_scene(path, *loaded(path)) for _ in range(2))
    assert first == second == scene_of()
    assert chosen == ["bump"]


def test_another_scene_is_completed_separately(path: Path, chosen: list[str]) -> None:
    scan, scene = loaded(path)
    completed_scene(path, scan, scene)
    completed_scene(path, scan, dataclasses.replace(scene, feature=None))
    assert len(chosen) == 2


def test_without_a_cache_the_scene_is_completed_again(path: Path, chosen: list[str]) -> None:
    missing = path.with_name("none.db")
    assert completed_scene(missing, *loaded(path)) == completed_scene(missing, *loaded(path))
    assert len(chosen) == 2


def test_tune_caches_the_completed_scene(path: Path, chosen: list[str]) -> None:
    assert main(["tune", "--scan", str(path)]) == 0
    completed_scene(path, *loaded(path))
    assert len(chosen) == 1
