"""Contact with a feature, recorded or from the map."""

from copy import copy
from dataclasses import replace

import numpy as np

from tactile_localizer.core.calibration.sweep_model import learn_sweep_model
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.io.recording import NO_CONTACT, Recording
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.offline.metrics import with_contact
from tactile_localizer.resources import resource_path
from tactile_localizer.sim import simulate_recording, simulate_scan

SCENE = load_scene(resource_path("config/scenes/bump.yaml"))


def unmarked(recording: Recording) -> Recording:
    return replace(recording, sweeps=tuple(replace(sweep, felt=None) for sweep in recording.sweeps))


def test_unrecorded_contact_is_taken_from_the_map() -> None:
    test = simulate_recording("bump", 1, "test")
    learned = learn_sweep_model(simulate_scan("bump", 1), SCENE, Material.SHEET)
    model = learned.mixture(SCENE, learned.cell(SCENE, 0.45))
    marked = with_contact(unmarked(test), model)
    away = []
    for own, found in zip(test.sweeps, marked.sweeps, strict=True):
        assert own.truth is not None
        ends = own.truth[list(own.contact), 0], own.truth[list(found.contact), 0]
        away.append(ends[1] - ends[0])
    assert np.abs(np.mean(away, axis=0)).max() < 0.002  # folds differ from sweep to sweep
    blank = unmarked(simulate_recording("none", 1, "test"))
    assert {sweep.contact for sweep in with_contact(blank, model).sweeps} == {NO_CONTACT}
    # The level of a sweep, which differs from session to session, says nothing.
    predicted = np.einsum("mk,mkc->mc", np.exp(model.map.log_prior), model.map.mean)
    level = np.linalg.solve(model.noise.whitening, predicted[np.argmax(np.abs(predicted).max(axis=1))])
    for recording, expected in ((blank, {NO_CONTACT}), (unmarked(test), {s.contact for s in marked.sweeps})):
        for sign in (-1.0, 1.0):
            other = tuple(replace(s, strain=s.strain + sign * level) for s in recording.sweeps)
            found = with_contact(replace(recording, sweeps=other), model)
            assert {sweep.contact for sweep in found.sweeps} == expected
    without_truth = replace(test, sweeps=tuple(replace(s, felt=None, truth=None) for s in test.sweeps))
    assert with_contact(without_truth, model).sweeps[0].felt is None
    textured = copy(model)
    textured.material = Material.CLOTH
    assert with_contact(unmarked(test), textured).sweeps[0].felt is None
