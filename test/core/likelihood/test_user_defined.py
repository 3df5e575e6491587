"""User-defined measurement models."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.scans import scan, scene

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_model
from tactile_localizer.core.likelihood.base import MeasurementModel
from tactile_localizer.core.parameters import ModelParameters
from tactile_localizer.errors import ParameterError

OWN = """
import numpy as np
from tactile_localizer.core.likelihood.base import MeasurementModel

class Slope(MeasurementModel):
    def __init__(self, scan, scene, parameters):
        self.made_of = scan, scene, parameters

    def log_likelihood(self, states, strain, present=None):
        return -((states[:, 0] - 0.01) / 0.002) ** 2 - ((states[:, 1] - 0.03) / 0.002) ** 2

def nothing(scan, scene, parameters):
    return "no model"
"""
SCENE = scene()
SCAN = scan(np.random.default_rng(1), SCENE)
PARAMETERS = ModelParameters(0.002, 0.03, 0.002)


@pytest.fixture(autouse=True)
def own_module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "slopes_of_ones_own.py").write_text(OWN)
    monkeypatch.syspath_prepend(tmp_path)


def model(name: str) -> MeasurementModel:
    return build_model(SCAN, SCENE, Configuration(model=name), PARAMETERS)


def test_a_user_defined_model_gets_scan_scene_and_parameters() -> None:
    made = model("slopes_of_ones_own:Slope")
    assert made.made_of == (SCAN, SCENE, PARAMETERS)  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("no_such_module_anywhere:Model", "PYTHONPATH"),
        ("slopes_of_ones_own:Hill", "expected a class Hill in slopes_of_ones_own, found None"),
        ("slopes_of_ones_own:nothing", "expected a class nothing in slopes_of_ones_own, found"),
    ],
)
def test_an_invalid_model_name_is_refused(name: str, reason: str) -> None:
    with pytest.raises(ParameterError, match=f"model '{name}': .*{reason}"):
        model(name)
