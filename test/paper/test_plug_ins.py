"""The paper's models are plug-ins: named as ``module:Class``, with arguments from a subclass."""

import sys
from pathlib import Path

import numpy as np
import paper_models
import pytest
from support.scans import bump_scan, scene
from support.sweeps import CALIBRATION

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.core.localizer import Localizer
from tactile_localizer.errors import ParameterError
from tactile_localizer.offline.replay_document import learned_values

SCENE = scene(2, 1)


def built(model: str) -> Localizer:
    rng = np.random.default_rng(0)
    return build_localizer(bump_scan(SCENE), SCENE, Configuration(model=model), rng, calibration=CALIBRATION)


def test_a_model_has_an_information_length_of_its_own() -> None:
    localizer = built("paper_models:PaperSum")
    assert localizer.information_length == paper_models.PaperSum.information_length
    assert localizer.explanation_length == CALIBRATION.examination.explanation_length, "that of the scan"
    assert learned_values(localizer, CALIBRATION)["information length"] == "0.5 mm"


@pytest.mark.parametrize("length", [0.0, -0.001, np.nan, "long", None])
def test_an_information_length_that_is_none_is_refused(monkeypatch: pytest.MonkeyPatch, length) -> None:
    monkeypatch.setattr(paper_models.PaperGaussian, "information_length", length)
    with pytest.raises(ParameterError, match="information_length of paper_models:PaperGaussian: expected"):
        built("paper_models:PaperGaussian")


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("def (", "Python's path .*SyntaxError: "),
        ("raise RuntimeError('no GPU')", "Python's path .*RuntimeError: no GPU .*own.py:1"),
        ("raise SystemExit(3)", "Python's path .*SystemExit: 3"),
        ("", "a class Own in own, found None"),
        ("class Own:\n def __init__(self, scan): 0", "with scan, scene, TypeError: "),
        ("class Own:\n def __init__(self, scan, scene): {}['index']", "KeyError: 'index' .*own.py:2"),
        ("class Own:\n def __init__(self, scan, scene): 0", "a measurement model, got Own"),
    ],
)
def test_a_model_that_cannot_be_made_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: str, message: str
) -> None:
    (tmp_path / "own.py").write_text(code)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "own", raising=False)
    with pytest.raises(ParameterError, match=f"model 'own:Own': expected .*{message}"):
        built("own:Own")


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (lambda states, strain: {}["index"], "log-likelihoods, KeyError: 'index' .*test_plug_ins.py:"),
        (lambda states, strain: None, "log-likelihoods, TypeError: "),
        (lambda states, strain: ["a"] * len(states), "log-likelihoods, .*Cannot cast"),
        (lambda states, strain: 0.0, "log-likelihoods of shape .*, got \\(\\)"),
        (lambda states, strain: np.zeros((len(states), 2)), "log-likelihoods of shape .*, got "),
        (lambda states, strain: np.full(len(states), np.nan), "finite log-likelihoods, got NaN"),
        (lambda states, strain: np.full(len(states), np.inf), "finite log-likelihoods, got NaN"),
    ],
)
def test_a_model_that_fails_says_where(monkeypatch: pytest.MonkeyPatch, made, message: str) -> None:
    likelihood = staticmethod(lambda states, strain, present: made(states, strain))
    monkeypatch.setattr(paper_models.PaperSum, "log_likelihood", likelihood)
    with pytest.raises(ParameterError, match=f"model 'paper_models:PaperSum': expected {message}"):
        built("paper_models:PaperSum").update(1, SCENE.lower, np.zeros(SCENE.layout.size))


def test_a_model_changes_nothing_of_the_localizer(monkeypatch: pytest.MonkeyPatch) -> None:
    def spoil(self, states: np.ndarray, strain: np.ndarray, present: np.ndarray) -> np.ndarray:
        states[:], strain[:] = np.nan, np.nan
        return np.zeros(len(states))

    monkeypatch.setattr(paper_models.PaperSum, "log_likelihood", spoil)
    estimate = built("paper_models:PaperSum").update(1, SCENE.lower, np.zeros(SCENE.layout.size))
    assert np.isfinite(estimate.mean).all()
