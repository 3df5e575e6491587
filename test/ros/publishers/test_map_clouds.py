"""The map is in the frame of the material."""

import numpy as np

from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.tactile_map import make_map
from tactile_localizer.ros.publishers.maps import map_cloud
from tactile_localizer.scene import Axis, Phalanx, Scene

SCENE = Scene(
    "bump",
    (Axis("x", 0.0, 0.05), Axis("y", 0.0, 0.05)),
    (Phalanx("index", (0.001, 0.01)), Phalanx("middle", (0.0, -0.01))),
)
BUMP = np.array([0.025, 0.028])
"""Where the bump is on the material."""


def scan_of(scene=SCENE) -> Scan:
    x, lines = np.linspace(0, 0.05, 200), np.arange(0, 0.0501, 0.0025)
    states = np.concatenate([np.column_stack([x, np.full_like(x, y)]) for y in lines])[:, : scene.dimension]
    places = [states + np.array(phalanx.offset) for phalanx in scene.phalanges]
    felt = [np.exp(-np.sum((p - BUMP[: scene.dimension]) ** 2, axis=1) / 2e-5) for p in places]
    strain = np.concatenate([np.outer(f, np.arange(1, 9)) for f in felt], axis=1)
    sweep = np.repeat(np.arange(len(lines)), len(x))
    return Scan(states, strain, sweep, scene.axis_names, scene.phalanx_names)


def fields_of(cloud) -> dict[str, np.ndarray]:
    points = np.frombuffer(cloud.data, "<f4").reshape(cloud.width, -1)
    return {field.name: points[:, field.offset // 4] for field in cloud.fields}


def test_each_phalanx_shows_the_feature_at_its_position():
    cloud = map_cloud(make_map(scan_of(), SCENE), "material")
    assert cloud.header.frame_id == "material"
    fields = fields_of(cloud)
    assert {*fields} == {"x", "y", "z", "intensity", "phalanx", *(f"element_{n}" for n in range(1, 9))}
    for phalanx in (0, 1):
        mine = fields["phalanx"] == phalanx
        strongest = np.flatnonzero(mine)[np.argmax(fields["intensity"][mine])]
        np.testing.assert_allclose([fields["x"][strongest], fields["y"][strongest]], BUMP, atol=1.5e-3)
        np.testing.assert_allclose(
            fields["element_8"][mine], 8 * fields["element_1"][mine], rtol=1e-5, atol=1e-6
        )


def test_parts_without_data_have_no_points():
    scan = scan_of()
    tactile_map = make_map(scan.select(scan.states[:, 1] < 0.02), SCENE)
    cloud = map_cloud(tactile_map, "material")
    assert cloud.width == 2 * tactile_map.covered.sum()
    assert np.isfinite(fields_of(cloud)["intensity"]).all()


def test_a_scene_of_one_axis_is_a_line():
    scene = Scene("line", SCENE.axes[:1], (Phalanx("index", (0.01,)),))
    fields = fields_of(map_cloud(make_map(scan_of(scene), scene), "material"))
    assert not fields["y"].any()
    np.testing.assert_allclose(fields["x"].min(), 0.01, atol=1e-6)
