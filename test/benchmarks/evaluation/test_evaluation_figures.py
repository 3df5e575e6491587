"""Figures of an evaluation: what they draw of the results."""

from __future__ import annotations

import numpy as np
import pytest
from evaluation.figures import (
    convergence,
    errors_of_methods,
    evaluation_figures,
)
from support.evaluations import results


def lines(plot) -> dict[str, np.ndarray]:
    return {line.get_label(): line.get_ydata() for line in plot.get_lines()}


def test_every_method_is_drawn() -> None:
    figure = errors_of_methods(results())
    names = [text.get_text() for text in figure.axes[0].get_yticklabels()]
    assert names == list(results().methods)


def test_the_convergence_curve_ends_at_the_converged_fraction() -> None:
    figure = convergence(results({"default": {"travel_to_convergence_m": None, "converged": False}}))
    drawn = lines(figure.axes[0])
    assert drawn["default"][-1] == 0.0
    assert drawn["fast"][-1] == pytest.approx(1.0)


def test_without_contact_whole_sweeps_are_compared() -> None:
    found = results({name: {"error_contact_m": None} for name in results().methods})
    assert found.compared_error() == ("error_m", "over the sweep")
    assert "convergence" not in evaluation_figures(found)
