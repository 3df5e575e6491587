"""Reading and writing scenes in YAML, with error messages that name the entry."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from tactile_localizer.channels import DEFAULT_CHANNELS
from tactile_localizer.core.parameters import ModelParameters
from tactile_localizer.errors import ParameterError, SceneError
from tactile_localizer.io.whole_file import whole_file
from tactile_localizer.io.yaml_file import load_yaml, mapping
from tactile_localizer.quantity import whole_number
from tactile_localizer.resources import resource_path
from tactile_localizer.scene import (
    DEFAULT_MOTION_STD,
    Axis,
    Phalanx,
    Region,
    Scene,
)

_MAX_NAME_CHARACTERS = 100

_KEYS = ("name", "axes", "phalanges", "feature", "measurement")


def load_scene(path: str | Path) -> Scene:
    """Read a scene from a YAML file.

    Raises
    ------
    SceneError
        The file is missing, is not YAML, or describes an invalid scene.
    """
    shipped = sorted(file.name for file in resource_path("config/scenes").iterdir())
    return load_yaml(path, f"a scene file or one of {', '.join(shipped)}", SceneError, scene_from_dict)


def save_scene(scene: Scene, path: str | Path) -> None:
    """Write a scene to a YAML file that :func:`load_scene` reads back as an equal scene.

    Raises
    ------
    SceneError
        The file cannot be written.
    """
    text = yaml.safe_dump(scene_to_dict(scene), sort_keys=False, default_flow_style=None, width=100)
    try:
        with whole_file(path) as unfinished:
            unfinished.write_text(text, encoding="utf-8")
    except OSError as error:
        raise SceneError(f"{path}: could not write the scene, {error.strerror}") from None


def scene_from_dict(content: Any) -> Scene:
    """Make a scene from its YAML form of mappings, lists and numbers.

    Raises
    ------
    SceneError
        A key is missing or unknown, or a value is of the wrong kind.
    """
    try:
        scene = _scene(content)
        ModelParameters.of_scene(scene)
    except ParameterError as error:
        raise SceneError(str(error)) from None
    return scene


def _scene(content: Any) -> Scene:
    top = mapping(content, "scene", _KEYS)
    axes = tuple(_axis(name, value) for name, value in mapping(top.get("axes"), "axes").items())
    names = tuple(axis.name for axis in axes)
    raw = top.get("phalanges")
    if isinstance(raw, list):
        raw = dict.fromkeys(_names(raw, "phalanges"))
    phalanges = tuple(
        _phalanx(_name(name, "phalanx"), value, names) for name, value in mapping(raw, "phalanges").items()
    )
    return Scene(
        name=_name(top.get("name", "scene"), "scene name"),
        axes=axes,
        phalanges=phalanges,
        feature=_region(top["feature"], names) if top.get("feature") is not None else None,
        measurement=dict(mapping(top.get("measurement") or {}, "measurement")),
    )


def scene_to_dict(scene: Scene) -> dict[str, Any]:
    """YAML form of a scene, made of plain mappings, lists and numbers."""
    names = scene.axis_names
    content: dict[str, Any] = {
        "name": scene.name,
        "axes": {
            axis.name: {
                "bounds": [float(axis.lower), float(axis.upper)],
                "motion_std": float(axis.motion_std),
            }
            for axis in scene.axes
        },
        "phalanges": {phalanx.name: _phalanx_to_dict(phalanx, names) for phalanx in scene.phalanges},
    }
    if scene.feature is not None:
        content["feature"] = {
            name: [float(low), float(high)]
            for name, low, high in zip(names, scene.feature.lower, scene.feature.upper, strict=True)
            if math.isfinite(low) or math.isfinite(high)
        }
    if scene.measurement:
        content["measurement"] = dict(scene.measurement)
    return content


def _phalanx_to_dict(phalanx: Phalanx, axes: tuple[str, ...]) -> dict[str, Any]:
    content: dict[str, Any] = {"offset": dict(zip(axes, map(float, phalanx.offset), strict=True))}
    return content if phalanx.channels == DEFAULT_CHANNELS else {**content, "channels": phalanx.channels}


def _name(value: Any, what: str) -> str:
    # A number in YAML is accepted as a name.
    text = "" if isinstance(value, bool | list | Mapping) else str(value)
    if not 1 <= len(text) <= _MAX_NAME_CHARACTERS or not text.isprintable():
        raise SceneError(
            f"{what}: expected text of 1 to {_MAX_NAME_CHARACTERS} printable characters, "
            f"got {reprlib.repr(value)}"
        )
    return text


def _names(values: list[Any], what: str) -> list[str]:
    names = [_name(value, what) for value in values]
    if len(set(names)) < len(names):
        raise SceneError(f"{what}: expected each name once, got {reprlib.repr(names)}")
    return names


def _interval(value: Any, what: str) -> tuple[float, float]:
    if not isinstance(value, list) or len(value) != 2:
        raise SceneError(f"{what}: expected [lower, upper], got {reprlib.repr(value)}")
    return value[0], value[1]


def _axis(name: Any, value: Any) -> Axis:
    entry = mapping(value, f"axis {name}", ("bounds", "motion_std"))
    lower, upper = _interval(entry.get("bounds"), f"axis {name} bounds")
    return Axis(str(name), lower, upper, entry.get("motion_std", DEFAULT_MOTION_STD))


def _phalanx(name: str, value: Any, axes: tuple[str, ...]) -> Phalanx:
    entry = mapping(value or {}, f"phalanx {name}", ("offset", "channels"))
    offset = mapping(entry.get("offset") or {}, f"phalanx {name} offset", axes)
    channels = whole_number(entry.get("channels", DEFAULT_CHANNELS), f"phalanx {name} channels")
    return Phalanx(name, tuple(offset.get(axis, 0.0) for axis in axes), channels)


def _region(value: Any, axes: tuple[str, ...]) -> Region:
    entry = mapping(value, "feature", axes)
    limits = [
        _interval(entry[axis], f"feature {axis}") if axis in entry else (-math.inf, math.inf) for axis in axes
    ]
    return Region(tuple(low for low, _ in limits), tuple(high for _, high in limits))
