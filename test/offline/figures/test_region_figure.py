"""Figure of the feature's region."""

import numpy as np
import pytest
from matplotlib.patches import Rectangle
from matplotlib.text import Text

from tactile_localizer.core.calibration.feature_region import Proposal, propose_region
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.offline.figures.feature_region import region_sheet
from tactile_localizer.offline.figures.tactile_map import DrawnScan
from tactile_localizer.scene import Axis, Phalanx, Region, Scene
from tactile_localizer.sim import simulate_scan

SCENE = Scene(
    "bump",
    (Axis("x", 0.0, 0.0508), Axis("y", 0.0, 0.0508)),
    (Phalanx("index", (0.0, 0.0127)), Phalanx("middle", (0.0, -0.0127))),
    Region((0.014, 0.0045), (0.048, np.inf)),
)


@pytest.fixture(scope="module")
def scan():
    return simulate_scan("bump", seed=1).to_scan()


def boxes(plot):
    return {patch.get_label(): patch.get_bbox() for patch in plot.patches if isinstance(patch, Rectangle)}


def test_the_given_and_the_proposed_region_are_outlined_on_every_phalanx(scan, tmp_path):
    proposal = propose_region(scan, SCENE)
    figure = region_sheet(DrawnScan(scan, SCENE), proposal)
    for plot in figure.axes[:2]:
        drawn = boxes(plot)
        np.testing.assert_allclose(drawn["given by the scene"].extents, [14, 4.5, 48, 63.5], atol=0.01)
        label = "proposed"
        extents = 1e3 * np.array([proposal.region.lower, proposal.region.upper]).ravel()
        np.testing.assert_allclose(drawn[label].extents, extents, atol=0.01)
        np.testing.assert_allclose(plot.get_ylim(), (-12.7, 63.5), atol=0.01)
    figure.savefig(tmp_path / "region.png", dpi=40)


def test_material_without_a_region_has_no_outline(scan, tmp_path):
    scene = Scene("plain", SCENE.axes, SCENE.phalanges)
    nothing = propose_region(scan, scene)
    plain = Proposal(None, [np.zeros_like(cells) for cells in nothing.cells], nothing.axes)
    figure = region_sheet(DrawnScan(scan, scene), plain)
    assert not boxes(figure.axes[0])
    assert any("no region found" in text.get_text() for text in figure.findobj(Text))
    figure.savefig(tmp_path / "region.png", dpi=40)


def test_one_axis_has_a_profile_per_phalanx(scan, tmp_path):
    scene = Scene(
        "line",
        SCENE.axes[:1],
        (Phalanx("index", (0.01,)), Phalanx("middle", (0.0,))),
        Region((0.02,), (0.04,)),
    )
    line = Scan(scan.states[:, :1], scan.strain, scan.sweep, ("x",), scan.phalanges)
    figure = region_sheet(DrawnScan(line, scene, "counts"), propose_region(line, scene))
    box = boxes(figure.axes[1])["given by the scene"]
    np.testing.assert_allclose([box.x0, box.x1], [20, 40])
    assert figure.axes[0].get_ylabel() == "counts"
    figure.savefig(tmp_path / "region.png", dpi=40)
