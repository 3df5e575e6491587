"""Contact with a feature, recorded or from the map."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from pathlib import Path

import numpy as np
from simulated import recording_of

from tactile_localizer.cli import main
from tactile_localizer.core.calibration.sweep_model import learn_sweep_model
from tactile_localizer.io.csv.recording import read_csv
from tactile_localizer.io.recording import NO_CONTACT, Recording
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.offline.metrics import with_contact
from tactile_localizer.resources import resource_path
from tactile_localizer.sim import simulate_scan

SCENE = load_scene(resource_path("config/scenes/bump.yaml"))


def test_a_simulated_recording_has_the_simulators_contact(tmp_path: Path) -> None:
    test = simulate_scan("bump", 1, "test", sweeps=2)
    assert main(["simulate", "bump", "-o", str(tmp_path), "--test", "2", "--train", "1"]) == 0
    from_file = read_csv(tmp_path / "test.csv", SCENE)
    of_scan = recording_of(test)
    for number, part in enumerate(test.slices()):
        expected = test.contact[number] - part.start, test.feature_end[number] - part.start
        assert from_file.sweeps[number].contact == expected
        assert of_scan.sweeps[number].contact == expected


def test_a_blank_sweep_has_no_contact() -> None:
    blank = recording_of(simulate_scan("bump", 1, "test", sweeps=1, reach_feature=False))
    assert blank.sweeps[0].contact == NO_CONTACT


def unmarked(recording: Recording) -> Recording:
    return replace(recording, sweeps=tuple(replace(sweep, felt=None) for sweep in recording.sweeps))


def test_unrecorded_contact_is_taken_from_the_map() -> None:
    test = recording_of(simulate_scan("bump", 1, "test"))
    learned = learn_sweep_model(simulate_scan("bump", 1).to_scan(), SCENE)
    model = learned.mixture(SCENE, learned.cell(SCENE, 0.45))
    marked = with_contact(unmarked(test), SCENE, model)
    away = []
    for own, found in zip(test.sweeps, marked.sweeps, strict=True):
        assert own.truth is not None
        ends = own.truth[list(own.contact), 0], own.truth[list(found.contact), 0]
        away.append(ends[1] - ends[0])
    assert np.abs(np.mean(away, axis=0)).max() < 0.002  # folds differ from sweep to sweep
    blank = unmarked(recording_of(simulate_scan("none", 1, "test")))
    assert {sweep.contact for sweep in with_contact(blank, SCENE, model).sweeps} == {NO_CONTACT}
    without_truth = replace(test, sweeps=tuple(replace(s, felt=None, truth=None) for s in test.sweeps))
    assert with_contact(without_truth, SCENE, model).sweeps[0].felt is None
    textured = copy(model)
    textured.map = model.map._replace(featureless_variance=None)
    assert with_contact(unmarked(test), SCENE, textured).sweeps[0].felt is None
