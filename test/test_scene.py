"""A scene that cannot be meant is refused with the place, and one that can survives its YAML form."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from tactile_localizer.errors import SceneError
from tactile_localizer.io.scene_file import load_scene, save_scene, scene_from_dict
from tactile_localizer.io.yaml_file import parse_yaml
from tactile_localizer.scene import Axis, Phalanx, Region, Scene

GOOD: dict[str, Any] = {
    "name": "strip",
    "axes": {"x": {"bounds": [0.0, 0.1], "motion_std": 0.002}, "yaw": {"bounds": [-0.5, 0.5]}},
    "phalanges": {"index": {"offset": {"x": 0.01}}, "thumb": None},
    "feature": {"x": [0.02, 0.05]},
}
INVALID = [
    ("axis: {}", "scene: expected one of name, axes, .*, got 'axis'"),
    ("axes: [x]", "axes: expected a mapping"),
    ("axes: {z: {bounds: [0, 1]}}", "axis 'z': expected one of x, y, yaw"),
    ("axes: {x: {}}", r"axis x bounds: expected \[lower, upper\], got None"),
    ("axes: {x: {bounds: [1, 0]}}", r"axis x: expected bounds \[lower, upper\] .*got \[1, 0\]"),
    ("axes: {x: {bounds: [here, there]}}", "expected a finite number, got 'here'"),
    ("axes: {x: {bounds: [false, true]}}", "expected a finite number, got False"),
    ("axes: {x: {bounds: [0, 1e300]}}", "axis x bounds: expected -1000 to 1000"),
    ("axes: {x: {bounds: [0, 1e-9]}}", "axis x: expected bounds .* at least 1e-06"),
    (
        "axes: {x: {bounds: [0, '0.1']}}",
        "expected a finite number, got '0.1'; remove the quotes",
    ),
    ("axes: {x: {bounds: [0, 1], motion_std: -1}}", "axis x motion_std: expected 0 to 1000, got -1"),
    ("axes: {x: {bounds: [0, 1], unit: m}}", "axis x: expected one of bounds, motion_std, got 'unit'"),
    ("axes: {yaw: {bounds: [-4, 4]}}", "axis yaw: expected at most a full turn"),
    ("axes: {}\nphalanges: {index: }\nfeature:", "expected one to three axes, got 0"),
    ("phalanges: {}", "scene strip: expected at least one phalanx"),
    ("phalanges: [index]", "phalanges: expected a mapping, got"),
    ("phalanges: {index: {offset: {y: 0.1}}}", "phalanx index offset: expected one of x, yaw, got 'y'"),
    ("phalanges: {index: {offset: {x: .inf}}}", "phalanx index offset x: expected a finite number, got inf"),
    ("phalanges: {index: {place: 1}}", "phalanx index: expected one of offset, channels, got 'place'"),
    (f"phalanges: {{{', '.join(f'p{n}: ' for n in range(101))}}}", "expected at most 100"),
    ('phalanges: {"a\\0": }', "expected text of 1 to 100 printable"),
    ("name: [1]", "scene name: expected text"),
    ("feature: {x: [0.04, 0.01]}", r"feature x: expected lower < upper, got \[0.04, 0.01\]"),
    ("feature: {x: [.nan, 0.01]}", "feature x: expected a number, got nan"),
    ("feature: {y: [0, 1]}", "feature: expected one of x, yaw, got 'y'"),
]


@pytest.mark.parametrize(("changed", "reason"), INVALID)
def test_invalid_scenes_are_refused_on_reading(tmp_path: Path, changed: str, reason: str) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump({**GOOD, **parse_yaml(changed)}))
    with pytest.raises(SceneError, match=f"{path}: .*{reason}"):
        load_scene(path)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (None, "expected a scene file or one of bump.yaml, .*, found none"),
        (b"\xff\xfe\x00", "could not read it: not UTF-8"),
        (b"- x", "scene: expected a mapping"),
        (b"stamp_s,x,y\n1,2,3\n" * 1000, "scene: expected a mapping, got .{1,40}$"),
    ],
)
def test_a_file_that_is_not_a_scene_is_refused(tmp_path: Path, content: bytes | None, reason: str) -> None:
    path = tmp_path / "scene.yaml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(SceneError, match=f"{path}: .*{reason}"):
        load_scene(path)


def test_a_scene_survives_its_file(tmp_path: Path) -> None:
    scene = scene_from_dict(GOOD)
    save_scene(scene, tmp_path / "scene.yaml")
    assert load_scene(tmp_path / "scene.yaml") == scene


def test_numbers_may_have_an_exponent_and_a_full_turn_wraps(tmp_path: Path) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text(
        """
        axes: {x: {bounds: [-5e-3, .5], motion_std: 3e-3}, yaw: {bounds: [-3.1416, 3.1416]}}
        phalanges: {index: {offset: {x: 1e-2}}, thumb: {}}
        feature: {yaw: [-.inf, 0.8]}
        """
    )
    scene = load_scene(path)
    assert (scene.axes[0].lower, scene.axes[0].upper, scene.axes[0].motion_std) == (-0.005, 0.5, 0.003)
    assert scene.wraps.tolist() == [False, True]
    assert scene.feature == Region((-math.inf, -math.inf), (math.inf, 0.8))


def test_cells_are_counted_before_they_are_allocated() -> None:
    sheet = Scene("sheet", (Axis("x", -3, 63), Axis("y", -3, 63)), (Phalanx("index", (0.0, 0.0)),))
    with pytest.raises(
        SceneError, match=r"at most 1,000,000 cells, got 1,089,000,000 .* -3 to 63 in m .in mm.."
    ):
        sheet.cells(0.002)
    assert sheet.cells(1.0).tolist() == [66, 66]


def test_an_infinite_bound_of_a_region_is_no_limit() -> None:
    region = scene_from_dict(GOOD).feature
    assert region is not None
    assert region.contains(np.array([[0.03, 9.0], [0.06, 0.0]])).tolist() == [True, False]


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"axes": (Axis("x", 0, 1), Axis("x", 0, 2))}, "axis 'x': expected once, found 2 times"),
        ({"phalanges": (Phalanx("index", (0.0, 0.0)),) * 2}, "phalanx 'index': expected once"),
        (
            {"phalanges": (Phalanx("index", (0.0,)),)},
            "phalanx index: expected 2 offsets, got",
        ),
        ({"feature": Region((0.0,), (1.0,))}, "expected a feature region of 2 axes"),
    ],
)
def test_a_scene_made_in_code_is_checked(change: dict[str, Any], reason: str) -> None:
    made = {
        "axes": (Axis("x", 0, 1), Axis("y", 0, 1)),
        "phalanges": (Phalanx("index", (0.0, 0.0)),),
        **change,
    }
    with pytest.raises(SceneError, match=reason):
        Scene("made", **made)


def test_a_missing_axis_is_named() -> None:
    scene = scene_from_dict(GOOD)
    with pytest.raises(SceneError, match=r"axis 'yaw' of scene 'strip': expected one of x, y"):
        scene.columns(("x", "y"))
