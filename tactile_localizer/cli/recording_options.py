"""Command-line options for reading recordings: columns of CSV files, topics and frames of bags."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from tactile_localizer.core.geometry.palm_frame import PalmFrame
from tactile_localizer.core.geometry.synchronization import DEFAULT_MAX_GAP_S
from tactile_localizer.errors import ParameterError
from tactile_localizer.io.csv.columns import ColumnNaming, load_naming, naming_from_dict, naming_from_pairs
from tactile_localizer.io.strain_adapter import load_adapter
from tactile_localizer.resources import given_or_shipped
from tactile_localizer.scene import Scene

_TOPICS = {
    "strain": ("/strain", "strain vectors"),
    "pose": ("/palm_pose", "measured palm poses"),
    "truth": ("/simulator/ground_truth", "true palm poses"),
    "status": ("/mapping/status", "status of the mapping node, for its sweeps"),
    "posterior": ("/filter/posterior", "posterior of the filter node, for global localizations"),
    "active": ("/simulator/sweep_active", "whether a sweep is in progress, for the localized sweeps"),
}


def add_csv_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options for CSV files: column names, speed, separate poses."""
    add = parser.add_argument_group("CSV files").add_argument
    add("--columns", metavar="YAML", help="column naming, if columns do not have the standard names")
    text = "name of a column: stamp_s=time_ms*0.001, index=gauge1..8 (repeatable)"
    add("--column", action="append", default=[], metavar="NAME=COLUMN", help=text)
    text = "constant speed, m/s, if positions were not recorded"
    add("--speed", action="append", default=[], metavar="[AXIS=]M_PER_S", help=text)
    text = (
        "CSV file of palm positions with their own stamps, interpolated at those of the strain (repeatable)"
    )
    add("--poses", action="append", default=[], metavar="FILE", help=text)


def add_bag_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options for bags: topics, frames, adapter."""
    add = parser.add_argument_group("bags").add_argument
    for name, (topic, text) in _TOPICS.items():
        add(f"--{name}-topic", default=topic, metavar="TOPIC", help=f"{text} (default: {topic})")
    text = "adapter from other messages to strain (docs/sensors.md): a file, or the name of a shipped one"
    add("--adapter", metavar="YAML", help=text)
    text = "frame of poses that need no transform"
    add("--material-frame", default="material", metavar="FRAME", help=text)
    text = "frame of poses to transform by --material-pose"
    add("--reference-frame", default="base_link", metavar="FRAME", help=text)
    text = "pose of the material in the reference frame, m and rad"
    names = ("X", "Y", "Z", "ROLL", "PITCH", "YAW")
    add("--material-pose", type=float, nargs=6, default=[0.0] * 6, metavar=names, help=text)


def add_gap_argument(parser: argparse.ArgumentParser) -> None:
    """Declare ``--max-gap``."""
    text = f"longest gap between poses that is interpolated, s (default: {DEFAULT_MAX_GAP_S:g})"
    parser.add_argument("--max-gap", type=float, default=DEFAULT_MAX_GAP_S, metavar="S", help=text)


def bag_options(args: argparse.Namespace, scene: Scene) -> dict[str, Any]:
    """Arguments of :func:`read_bag` from the options of ``add_bag_arguments``."""
    # Imported here because rosbags takes 0.3 s, which CSV files do not need.
    from tactile_localizer.io.bags.recording import BagTopics

    topics = BagTopics(**{name: getattr(args, f"{name}_topic") for name in _TOPICS})
    frame = PalmFrame(scene.axes, args.material_frame, args.reference_frame, args.material_pose)
    adapter = load_adapter(given_or_shipped(args.adapter, "config/adapters")) if args.adapter else None
    return {"topics": topics, "frame": frame, "max_gap_s": args.max_gap, "adapter": adapter}


def naming_from_arguments(
    args: argparse.Namespace, scene: Scene | None, imported: Mapping[str, Any] | None = None
) -> ColumnNaming:
    """The column naming of ``--columns``, ``--column`` and ``--speed``.

    Parameters
    ----------
    args : the command line
    scene : gives the axis of a speed without one; ``None``: x
    imported : naming that the scan was imported with, in its YAML form; replaced by ``--columns``

    Raises
    ------
    ParameterError
        A speed is not a number, or names no axis although the scene has several.
    """
    base = naming_from_dict(imported or {})
    if args.columns:
        base = load_naming(given_or_shipped(args.columns, "config/import"))
    naming = naming_from_pairs(args.column, base)
    return replace(naming, speed={**naming.speed, **_speeds(args.speed, scene)})


def _speeds(texts: Sequence[str], scene: Scene | None) -> dict[str, float]:
    names = scene.axis_names if scene else ("x",)
    speeds = {}
    for text in texts:
        axis, equals, value = text.rpartition("=")
        if not equals and len(names) > 1:
            raise ParameterError(f"speed {text!r}: expected AXIS=M_PER_S, the scene has {len(names)} axes")
        try:
            speeds[axis or names[0]] = float(value)
        except ValueError:
            raise ParameterError(f"speed {text!r}: expected a number of m/s") from None
    return speeds
