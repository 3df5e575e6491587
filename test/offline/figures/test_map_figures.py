"""Figures of a scan: channels in one colour scale, millimetres."""

import numpy as np
import pytest
from matplotlib.collections import QuadMesh
from matplotlib.patches import Rectangle

from tactile_localizer.core.calibration.examination import Examination
from tactile_localizer.core.calibration.trials import Outcome
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.tactile_map import make_map
from tactile_localizer.offline.figures.examination import held_out_figure
from tactile_localizer.offline.figures.tactile_map import MapFigures
from tactile_localizer.scene import Axis, Phalanx, Region, Scene

SCENE = Scene(
    "bump",
    (Axis("x", 0.0, 0.05), Axis("y", 0.0, 0.04)),
    (Phalanx("index", (0.0, 0.01)), Phalanx("middle", (0.0, -0.01))),
    Region((0.02, -np.inf), (0.03, np.inf)),
)


@pytest.fixture(scope="module")
def scan():
    x, lines = np.linspace(0, 0.05, 100), np.arange(0, 0.0401, 0.004)
    states = np.concatenate([np.column_stack([x, np.full_like(x, y)]) for y in lines])
    bump = np.exp(-((states[:, :1] - 0.025) ** 2 + (states[:, 1:] - 0.02) ** 2) / 1e-5)
    strain = 1.0 + bump * np.linspace(-1, 1, 16)
    return Scan(
        states, strain, np.repeat(np.arange(1, len(lines) + 1), len(x)), ("x", "y"), ("index", "middle")
    )


def meshes(figure):
    return [artist for plot in figure.axes for artist in plot.collections if isinstance(artist, QuadMesh)]


def test_a_scan_over_two_axes_has_a_sheet_for_each_phalanx(scan):
    assert list(MapFigures(scan, SCENE).channels()) == ["map_index", "map_middle"]


def test_all_channels_share_one_symmetric_colour_scale(scan):
    tactile_map = make_map(scan, SCENE)
    figures = MapFigures(scan, SCENE).channels()
    sheets = [figures["map_index"], figures["map_middle"]]
    drawn = [mesh for sheet in sheets for mesh in meshes(sheet)]
    sheets = [mesh for mesh in drawn if mesh.get_array().size == tactile_map.covered.size]
    assert len(sheets) == 16
    assert {(mesh.norm.vmin, mesh.norm.vmax, mesh.get_cmap().name) for mesh in sheets} == {
        (sheets[0].norm.vmin, -sheets[0].norm.vmin, "RdBu_r")
    }


def test_the_region_is_outlined_in_palm_coordinates(scan):
    scene = Scene("bump", SCENE.axes, SCENE.phalanges, Region((0.02, 0.015), (0.03, 0.035)))
    figure = MapFigures(scan, scene).channels()["map_index"]
    plot = figure.axes[1]  # after the paths of the sweeps
    (box,) = (patch for patch in plot.patches if isinstance(patch, Rectangle))
    extents = box.get_extents().transformed(plot.transData.inverted()).extents
    np.testing.assert_allclose(extents, [20.0, 5.0, 30.0, 25.0])
    drawn = plot.get_children()
    (mesh,) = (artist for artist in drawn if isinstance(artist, QuadMesh))
    assert drawn.index(box) > drawn.index(mesh), "what is drawn later lies above"


def test_axes_have_millimetres(scan):
    figure = MapFigures(scan, SCENE).channels()["map_index"]
    assert [plot.get_xlabel() for plot in figure.axes[:9]] == 4 * [""] + 5 * ["x, mm"]
    assert [plot.get_ylabel() for plot in figure.axes[:9]] == ["y, mm", "", "", "", "", "y, mm", "", "", ""]
    np.testing.assert_allclose(figure.axes[0].get_xlim(), (0, 50), atol=0.5)


def test_a_scan_over_one_axis_has_profiles(scan):
    scene = Scene("line", SCENE.axes[:1], (Phalanx("index", (0.0,)),), Region((0.02,), (0.03,)))
    line = Scan(scan.states[:, :1], scan.strain[:, :8], scan.sweep, ("x",), ("index",))
    figures = MapFigures(line, scene, "counts").channels()
    assert list(figures) == ["map_index"]
    assert len(figures["map_index"].axes) == 8


def test_a_single_sweep_can_be_drawn(scan, tmp_path):
    figures = MapFigures(scan.select(scan.sweep == 3), SCENE).channels()
    for name, figure in figures.items():
        figure.savefig(tmp_path / f"{name}.png", dpi=30)


def test_held_out_sweeps_are_counted_from_one_as_in_the_findings():
    outcomes = tuple(
        Outcome(sweep, True, -1.0, True, False, 1.0, 1.0, (0.001,) * 2, (0.001,) * 2) for sweep in (0, 2)
    )
    (plot, _) = held_out_figure(Examination(outcomes=outcomes), SCENE, (4.0, 3.0)).axes
    assert plot.collections[0].get_offsets()[:, 0].tolist() == [1.0, 3.0]
