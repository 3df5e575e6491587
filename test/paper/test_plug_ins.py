"""The paper's models are plug-ins: named as ``module:Class``, with arguments from a subclass."""

from __future__ import annotations

import numpy as np
import paper_models
import pytest
from support.scans import bump_scan, scene
from support.sweeps import CALIBRATION

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.core.localizer import Localizer
from tactile_localizer.errors import ParameterError

SCENE = scene(2, 1)


def built(model: str) -> Localizer:
    rng = np.random.default_rng(0)
    return build_localizer(bump_scan(SCENE), SCENE, Configuration(model=model), rng, calibration=CALIBRATION)


def test_a_model_has_the_information_length_of_the_scan_or_its_own() -> None:
    of_scan = CALIBRATION.examination.information_length
    assert built("tactile_localizer.paper:SumOfGaussians").information_length == of_scan
    assert built("paper_models:PaperSum").information_length == Configuration().update_distance


@pytest.mark.parametrize("length", [0.0, -0.001, np.nan, "long", None])
def test_an_information_length_that_is_none_is_refused(monkeypatch: pytest.MonkeyPatch, length) -> None:
    monkeypatch.setattr(paper_models.PaperGaussian, "information_length", length)
    with pytest.raises(ParameterError, match="information_length of paper_models:PaperGaussian: expected"):
        built("paper_models:PaperGaussian")
