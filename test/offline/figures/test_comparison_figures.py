"""The pictures of an evaluation show the curves that the results hold."""

from __future__ import annotations

import numpy as np
import pytest
from support.evaluations import results

from tactile_localizer.offline.evaluation.findings import GAUSSIAN, SUM
from tactile_localizer.offline.figures.comparison import (
    compared_error,
    convergence,
    error_along_sweep,
    error_and_trace,
    errors_of_methods,
    evaluation_figures,
)


def lines(plot) -> dict[str, np.ndarray]:
    return {line.get_label(): line.get_ydata() for line in plot.get_lines()}


def test_figure_5_has_the_mean_error_of_the_papers_three_models_in_mm() -> None:
    found = results(
        {SUM: {"error_curve_m": [0.003] * 50}, GAUSSIAN: {"error_curve_m": [None] * 25 + [0.006] * 25}}
    )
    (plot,) = error_along_sweep(found, "bump").axes
    drawn = lines(plot)
    assert set(drawn) == {"Gaussian", "Gaussian, fingers apart", "sum of Gaussians"}
    np.testing.assert_allclose(drawn["sum of Gaussians"], 3.0)
    assert len(drawn["Gaussian"]) == 25


def test_figure_8_has_error_and_trace_with_and_without_featureless_regions() -> None:
    found = results({SUM: {"trace_curve_m2": [5e-6] * 50}})
    error, trace = error_and_trace(found, "snap").axes
    assert set(lines(error)) == set(lines(trace)) == {"featureless apart", "sum of Gaussians"}
    np.testing.assert_allclose(lines(trace)["sum of Gaussians"], 5.0)


def test_every_method_stands_beside_the_others() -> None:
    figure = errors_of_methods(results())
    names = [text.get_text() for text in figure.axes[0].get_yticklabels()]
    assert names == list(results().methods)


def test_convergence_rises_to_the_share_that_converged() -> None:
    figure = convergence(results({"default": {"travel_to_convergence_m": None, "converged": False}}))
    drawn = lines(figure.axes[0])
    assert drawn["default"][-1] == 0.0
    assert drawn["sum of Gaussians"][-1] == pytest.approx(1.0)


def test_without_contact_whole_sweeps_are_compared() -> None:
    found = results({name: {"error_contact_m": None} for name in results().methods})
    assert compared_error(found) == ("error_m", "over the sweep")
    assert "convergence" not in evaluation_figures(found)
