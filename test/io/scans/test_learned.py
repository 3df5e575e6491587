"""Calibrations are learned once for the same pairs and scene, and storing them never fails."""

import dataclasses
import logging
import os

import numpy as np
import pytest
from support.sweeps import write_scan

from tactile_localizer.core.calibration.calibration import Calibration
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.core.likelihood.strain_map import VarianceModel
from tactile_localizer.core.scan.digest import digest_of
from tactile_localizer.io.scans import learned as module
from tactile_localizer.io.scans.learned import learned_calibration
from tactile_localizer.library import load_scan


@pytest.fixture
def calibrated(monkeypatch):
    """Names of the calibrated scenes; replaces a calibration that takes seconds."""
    names = []

    def learn_model(_scan, scene, _progress):
        names.append(scene.name)
        std, variance = np.full(scene.dimension, 0.0004), VarianceModel(0.7, 0.1, 0.4, 0.005)
        return Calibration(std, Material.SHEET, variance), None

    monkeypatch.setattr(module, "learn_model", learn_model)
    return names


@pytest.fixture
def path(tmp_path):
    write_scan(tmp_path / "scan", calibrated=False)
    return tmp_path / "scan"


def test_a_scan_is_calibrated_once(path, calibrated):
    first, second = (learned_calibration(path, *load_scan(path)) for _ in range(2))
    for each in (first, second):
        np.testing.assert_array_equal(each.registration_std, 0.0004)
    assert second.variance == VarianceModel(0.7, 0.1, 0.4, 0.005)
    assert second.material is Material.SHEET
    assert calibrated == ["bump"]


def test_another_name_of_the_scene_needs_no_other_calibration(path, calibrated):
    scan, scene = load_scan(path)
    for name in ("bump", "other"):
        learned_calibration(path, scan, dataclasses.replace(scene, name=name))
    assert calibrated == ["bump"]


def test_a_calibration_for_another_scene_leaves_that_of_the_scan(path, calibrated):
    scan, scene = load_scan(path)
    for _ in range(2):
        for each in (scene, dataclasses.replace(scene, name="one", phalanges=scene.phalanges[:1])):
            learned_calibration(path, scan, each)
    assert calibrated == ["bump", "one"]


def test_a_flipped_byte_is_calibrated_again(path, calibrated):
    learned_calibration(path, *load_scan(path))
    file = path / "calibration.json"
    good = file.read_bytes()
    for count, place in enumerate(np.random.default_rng(0).choice(len(good), 20, replace=False), start=2):
        file.write_bytes(good[:place] + bytes([good[place] ^ 1]) + good[place + 1 :])
        learned_calibration(path, *load_scan(path))
        assert len(calibrated) == count


@pytest.mark.parametrize("content", ["{}", "[1]", "x", "[" * 100_000, "huge", None])
def test_an_invalid_file_is_calibrated_again(path, calibrated, content):
    if content is None:
        os.mkfifo(path / "calibration.json")
    else:
        (path / "calibration.json").write_text(content)
        if content == "huge":
            os.truncate(path / "calibration.json", 2**40)
    assert learned_calibration(path, *load_scan(path)).registration_std[0] == 0.0004
    assert len(calibrated) == 1


def test_a_folder_that_cannot_be_written_gives_a_warning(path, calibrated, caplog, monkeypatch):
    # Loggers that are made after ``launch`` has been imported, as by its pytest plugin, do not propagate.
    monkeypatch.setattr(logging.getLogger(module.__name__), "propagate", True)
    for _ in range(2):
        learned_calibration(path / "scene.yaml", *load_scan(path))
    assert len(calibrated) == 2
    assert "scene.yaml/calibration.json: could not be written, File exists" in caplog.text


def test_the_digest_changes_with_the_scan_and_what_the_scene_means(path):
    scan, scene = load_scan(path)
    strain, states = scan.strain.copy(), scan.states.copy()
    strain[7, 3] = np.nextafter(strain[7, 3], 1.0)
    states[0, 0] += 1e-9
    others = [
        digest_of(dataclasses.replace(scan, strain=strain), scene),
        digest_of(dataclasses.replace(scan, states=states), scene),
        digest_of(dataclasses.replace(scan, sweep=scan.sweep + 1), scene),
        digest_of(scan.select(np.arange(19)), scene),
        digest_of(scan, dataclasses.replace(scene, phalanges=scene.phalanges[:1])),
    ]
    assert len({digest_of(scan, scene), *others}) == 1 + len(others)
    same = dataclasses.replace(scan, states=np.asfortranarray(scan.states), sweep=scan.sweep.astype(np.int32))
    assert digest_of(scan, scene) == digest_of(same, dataclasses.replace(scene, name="other"))
