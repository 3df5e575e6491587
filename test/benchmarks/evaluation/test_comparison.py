"""Evaluation of methods on conditions."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from evaluation import comparison
from evaluation.comparison import Trial, choose_widths, evaluate, localize
from evaluation.conditions import SimulatedCondition
from evaluation.jobs import Workers
from evaluation.methods import PAPER_PARAMETERS, standard_methods
from evaluation.tables import times
from support.evaluations import CALIBRATION, QUICK, TUNED, condition, results

from tactile_localizer.core.parameters import ModelParameters


def measured(trial: Trial) -> dict[str, Any]:
    """Made-up result of a trial."""
    error_m = 0.001 * trial.condition.seed
    timing = {"update_median_us": 200.0, "update_p99_us": 300.0}
    return {"sweeps": [{"error_contact_m": error_m}], "blanks": [], "timing": timing}


def test_every_method_is_tried_on_every_condition(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(comparison, "learn_condition", lambda condition: CALIBRATION)
    found = evaluate([condition(1), condition(2)], QUICK, tmp_path, Workers(1), measure=measured)
    assert found.condition_names == ["bump"]
    for method in ("default", "other"):
        assert len(found.sweeps(method)) == 2
        assert np.isfinite(found.values(method, "error_contact_m")).all()
        assert found.interval(method, "error_contact_m").low > 0
        assert times(found, method)[0] > 0


def test_widths_given_by_a_scene_are_kept() -> None:
    parameters = choose_widths(condition())
    assert parameters == {**TUNED, "neighbours": 8}


def test_a_simulated_condition_has_its_contacts_and_blank_sweeps() -> None:
    material = SimulatedCondition("snap", 3, sweeps=2, blanks=1).load()
    assert len(material.recording.sweeps) == 2
    for sweep in material.recording.sweeps:
        first, last = sweep.contact
        assert 0 < first < last < len(sweep)
        assert not np.allclose(sweep.position[0], sweep.truth[0])
    (blank,) = material.blank.sweeps
    assert blank.truth[:, 0].max() < 0.0145


def test_blank_sweeps_are_replayed_too() -> None:
    tried = SimulatedCondition("bump", 1, sweeps=1, blanks=1)
    outcome = localize(Trial(tried, QUICK[0].configuration, CALIBRATION))
    assert len(outcome["blanks"]) == 1


def test_a_recording_keeps_its_contact_and_differs_by_seed() -> None:
    material = condition(1).load()
    assert material.blank is None
    assert all(sweep.contact[0] > 0 for sweep in material.recording.sweeps)
    assert condition(1).identity != condition(2).identity
    assert condition(1).identity["data"] == condition(2).identity["data"]


def test_conditions_on_one_scan_share_its_calibration() -> None:
    assert condition(1).map_identity == condition(2).map_identity
    other = replace(condition(1), scan=condition(1).scan.select(np.arange(100)))
    assert other.map_identity != condition(1).map_identity
    seeds = [SimulatedCondition("bump", seed) for seed in (1, 2)]
    assert seeds[0].map_identity != seeds[1].map_identity


def test_standard_methods_contain_default_presets_and_paper_models() -> None:
    methods = standard_methods()
    assert {"default", "fast", "balanced"} <= methods.keys()
    for model in ("gaussian", "gaussian_independent", "sum_of_gaussians", "featureless"):
        paper, exact = methods[f"{model}-paper"], methods[f"{model}-paper-grid"]
        assert paper.configuration.particles == 75
        assert paper.configuration.random_particles == 10
        assert exact.configuration.filter == "grid"
        assert paper.measurement == exact.measurement == PAPER_PARAMETERS


def test_missing_kernel_widths_are_chosen() -> None:
    open_scene = replace(condition().scene, measurement={"strain_std": 0.03})
    chosen = ModelParameters.from_mapping(choose_widths(replace(condition(), scene=open_scene)))
    assert chosen.strain_std == 0.03
    assert np.all(np.asarray(chosen.position_std) > 0.0)


def test_the_papers_widths_are_variances_in_inches() -> None:
    assert PAPER_PARAMETERS["position_std"] == pytest.approx(np.sqrt(0.0075) * 0.0254)
    assert PAPER_PARAMETERS["strain_std"] == pytest.approx(np.sqrt(0.001))


def test_results_are_selected_by_condition() -> None:
    found = results(sweeps=5)
    assert len(found.sweeps("default")) == 10
    assert len(found.sweeps("default", "snap")) == 5
    assert len(found.blanks("default", "bump")) == 3
