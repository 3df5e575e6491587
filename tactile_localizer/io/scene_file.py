"""Reading and writing scenes in YAML, with error messages that name the entry."""

import math
import reprlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from tactile_localizer.channels import DEFAULT_CHANNELS
from tactile_localizer.errors import ParameterError, ScanError, SceneError
from tactile_localizer.io.whole_file import write_text
from tactile_localizer.io.yaml_file import load_yaml, mapping
from tactile_localizer.quantity import whole_number
from tactile_localizer.resources import resource_path
from tactile_localizer.scene import DEFAULT_MOTION_STD, Axis, Phalanx, Region, Scene

_MAX_NAME_CHARACTERS = 100

_KEYS = ("name", "axes", "phalanges", "feature")


def load_scene(path: str | Path) -> Scene:
    """Read a scene from a YAML file.

    Raises
    ------
    SceneError
        The file is missing, is not YAML, or describes an invalid scene.
    """
    shipped = sorted(file.name for file in resource_path("config/scenes").iterdir())
    return load_yaml(path, f"a scene file or one of {', '.join(shipped)}", SceneError, scene_from_dict)


def require_same_scene(found: Mapping[str, Any], expected: Mapping[str, Any], where: str) -> None:
    """Require that two scenes, in their YAML form, are the same.

    Raises
    ------
    ScanError
        They differ; the message begins with ``where`` and names the difference.
    """
    for name in _KEYS:
        if found.get(name) != expected.get(name):
            raise ScanError(f"{where}: expected the {name} {expected.get(name)}, found {found.get(name)}")


def save_scene(scene: Scene, path: str | Path) -> None:
    """Write a scene to a YAML file that :func:`load_scene` reads back as an equal scene.

    Raises
    ------
    SceneError
        The file cannot be written.
    """
    text = yaml.safe_dump(scene_to_dict(scene), sort_keys=False, default_flow_style=None, width=100)
    write_text(path, text, SceneError)


def scene_from_dict(content: Any) -> Scene:
    """Make a scene from its YAML form of mappings, lists and numbers.

    Raises
    ------
    SceneError
        A key is missing or unknown, or a value is of the wrong kind.
    """
    try:
        return _scene(content)
    except ParameterError as error:
        raise SceneError(str(error)) from None


def _scene(content: Any) -> Scene:
    top = mapping(content, "scene", _KEYS)
    axes = tuple(_axis(str(name), value) for name, value in mapping(top.get("axes"), "axes").items())
    names = tuple(axis.name for axis in axes)
    phalanges = mapping(top.get("phalanges"), "phalanges").items()
    feature = None
    if top.get("feature") is not None:
        entry = mapping(top["feature"], "feature", names)
        limits = [_interval(entry.get(name, [-math.inf, math.inf]), f"feature {name}") for name in names]
        feature = Region(tuple(low for low, _ in limits), tuple(high for _, high in limits))
    return Scene(
        name=_name(top.get("name", "scene"), "scene name"),
        axes=axes,
        phalanges=tuple(_phalanx(_name(name, "phalanx"), value, names) for name, value in phalanges),
        feature=feature,
    )


def scene_to_dict(scene: Scene) -> dict[str, Any]:
    """YAML form of a scene, made of plain mappings, lists and numbers."""
    axes = {axis.name: [float(axis.lower), float(axis.upper)] for axis in scene.axes}
    content: dict[str, Any] = {
        "name": scene.name,
        "axes": {
            axis.name: {"bounds": axes[axis.name], "motion_std": float(axis.motion_std)}
            for axis in scene.axes
        },
        "phalanges": {
            each.name: {
                "offset": dict(zip(axes, map(float, each.offset), strict=True)),
                **({"channels": each.channels} if each.channels != DEFAULT_CHANNELS else {}),
            }
            for each in scene.phalanges
        },
    }
    if scene.feature is not None:
        limits = zip(axes, scene.feature.lower, scene.feature.upper, strict=True)
        finite = [each for each in limits if math.isfinite(each[1]) or math.isfinite(each[2])]
        content["feature"] = {name: [float(low), float(high)] for name, low, high in finite}
    return content


def _name(value: Any, what: str) -> str:
    # A number in YAML is accepted as a name.
    text = "" if isinstance(value, bool | list | Mapping) else str(value)
    if not 1 <= len(text) <= _MAX_NAME_CHARACTERS or not text.isprintable():
        expected = f"text of 1 to {_MAX_NAME_CHARACTERS} printable characters"
        raise SceneError(f"{what}: expected {expected}, got {reprlib.repr(value)}")
    return text


def _interval(value: Any, what: str) -> list[Any]:
    if not isinstance(value, list) or len(value) != 2:
        raise SceneError(f"{what}: expected [lower, upper], got {reprlib.repr(value)}")
    return value


def _axis(name: str, value: Any) -> Axis:
    entry = mapping(value, f"axis {name}", ("bounds", "motion_std"))
    bounds = _interval(entry.get("bounds"), f"axis {name} bounds")
    return Axis(name, bounds[0], bounds[1], entry.get("motion_std", DEFAULT_MOTION_STD))


def _phalanx(name: str, value: Any, axes: tuple[str, ...]) -> Phalanx:
    entry = mapping(value or {}, f"phalanx {name}", ("offset", "channels"))
    offset = mapping(entry.get("offset") or {}, f"phalanx {name} offset", axes)
    channels = whole_number(entry.get("channels", DEFAULT_CHANNELS), f"phalanx {name} channels")
    return Phalanx(name, tuple(offset.get(axis, 0.0) for axis in axes), channels)
