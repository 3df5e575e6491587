"""Proportions of plots of the material."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from tactile_localizer.offline.figures.proportions import keep_proportions, plan_size
from tactile_localizer.scene import Axis, Phalanx, Scene


def scene(width: float, height: float, second: str = "y") -> Scene:
    axes = Axis("x", 0.0, width), Axis(second, 0.0, height)
    return Scene("sheet", axes, (Phalanx("index", (0.0, 0.0)),))


@pytest.mark.parametrize(("width", "height"), [(0.2, 0.02), (0.05, 0.05), (0.02, 0.05)])
def test_a_plot_of_the_material_fills_its_figure(width: float, height: float) -> None:
    _, size_in = plan_size(scene(width, height), 4.7)
    figure = Figure(figsize=size_in, layout="constrained")
    plot = figure.subplots()
    plot.set(xlim=(0.0, width), ylim=(0.0, height), xlabel="x, mm", ylabel="y, mm")
    keep_proportions(plot, ("x", "y"))
    figure.draw_without_rendering()
    shown = plot.get_position().bounds[2:] * np.array(size_in)
    assert shown[1] / shown[0] == pytest.approx(height / width, rel=0.02)
    assert shown[0] > 3.0


def test_plots_of_a_strip_stand_above_each_other() -> None:
    assert plan_size(scene(0.2, 0.02), 4.7, plots=4, columns=2)[0] == 1
    assert plan_size(scene(0.05, 0.05), 4.7, plots=4, columns=2)[0] == 2


def test_an_angle_has_no_proportion() -> None:
    plot = Figure().subplots()
    keep_proportions(plot, ("x", "yaw"))
    assert plot.get_box_aspect() is None
    assert plan_size(scene(0.2, 0.02, "yaw"), 4.7) == plan_size(scene(0.02, 0.2, "yaw"), 4.7)
