"""The examination of a scan by its own sweeps."""

import numpy as np
import pytest
from support.scans import raster, slides

from tactile_localizer.core.calibration import examination as module
from tactile_localizer.core.calibration.examination import (
    UNEXAMINED,
    Examination,
    Outcome,
    _as_good,
)
from tactile_localizer.core.factory import learn
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Axis, Phalanx, Scene

SHEET = Scene(
    "sheet",
    (Axis("x", 0.0, 0.05, 0.003), Axis("y", 0.0, 0.04, 0.003)),
    (Phalanx("index", (0.0, 0.0), 4), Phalanx("thumb", (0.0, 0.0), 4)),
)


def scan(slope: float) -> Scan:
    """A seam across the lines, 10 V high, whose strain changes along it by ``slope`` per mm; noise of 1 V."""
    rng = np.random.default_rng(0)

    def strain(states: np.ndarray, _: np.ndarray) -> np.ndarray:
        seam = 10.0 * np.exp(-0.5 * ((states[:, 0] - 0.025) / 0.003) ** 2)
        turned = slope * 1e3 * (states[:, 1:] - 0.02) + np.linspace(0.0, 3.0, 8)
        return seam[:, None] * np.sin(turned) + rng.standard_normal((len(states), 8))

    return raster(SHEET, strain, spacing=0.004)


@pytest.fixture(scope="module", params=[0.0, 0.15], ids=["seam", "feature"])
def examined(request: pytest.FixtureRequest) -> tuple[float, Examination]:
    return request.param, learn(scan(request.param), SHEET).examination


def test_an_axis_along_which_nothing_differs_is_not_observed(examined: tuple[float, Examination]) -> None:
    slope, examination = examined
    assert examination.observed[0] > 0.5
    assert (examination.observed[1] > 0.5) == (slope > 0.0)


def test_where_places_cannot_be_distinguished_none_is_claimed(examined: tuple[float, Examination]) -> None:
    slope, examination = examined
    right = sum(each.right for each in examination.on_map)
    assert not any(each.wrong for each in examination.outcomes)
    assert right > 0.5 * len(examination.on_map) if slope else right == 0


def test_the_score_is_beside_that_of_ignorance(examined: tuple[float, Examination]) -> None:
    slope, examination = examined
    area = np.pi * 0.0075**2 / np.prod(SHEET.extent + 0.0)
    assert examination.ignorance == pytest.approx(np.log(area), abs=0.1)
    assert examination.score > examination.ignorance or not slope


def test_a_single_sweep_cannot_be_examined() -> None:
    line = Scene("line", (Axis("x", 0.0, 0.1),), (Phalanx("index", (0.0,), 2),))
    x, rng = np.arange(0.0, 0.1, 0.0005), np.random.default_rng(0)
    examination = learn(slides(line, x, [rng.standard_normal((len(x), 2))]), line).examination
    assert examination == Examination()
    assert examination.information_length == UNEXAMINED
    assert examination.score == examination.ignorance


def outcomes(*scores: float) -> list[Outcome]:
    return [
        Outcome(n, True, score, True, False, True, (0.0,), (0.0,), (0.0,)) for n, score in enumerate(scores)
    ]


def test_scores_within_a_standard_error_are_as_good() -> None:
    best = outcomes(-1.0, -1.0, -1.0, -1.0)
    assert _as_good(best, best)
    assert _as_good(outcomes(-1.3, -0.9, -1.3, -0.9), best)
    assert not _as_good(outcomes(-1.3, -1.2, -1.3, -1.2), best)


def test_of_lengths_that_are_as_good_the_fewest_false_claims_decide(monkeypatch: pytest.MonkeyPatch) -> None:
    """Then the score on the map."""
    claims = {0.0017: (-0.9, True), 0.003: (-1.0, False), 0.005: (-0.95, False)}

    def localized(_trial: object, length: float) -> Outcome:
        score, wrong = claims.get(length, (-5.0, False))
        jitter = 0.5 * (-1.0) ** _trial.sweep * (length < 0.004)  # type: ignore[attr-defined]
        return Outcome(_trial.sweep, _trial.on_map, score + jitter, True, wrong, True, (0.0,) * 2, (0.0,) * 2)  # type: ignore[attr-defined]

    monkeypatch.setattr(module, "_localize", localized)
    assert learn(scan(0.15), SHEET).examination.information_length == 0.005
