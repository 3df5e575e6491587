"""Command-line options for reading recordings: columns of CSV files, topics and frames of bags."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from tactile_localizer.core.geometry.palm_frame import PalmFrame
from tactile_localizer.core.geometry.pose_buffer import DEFAULT_MAX_GAP_S
from tactile_localizer.errors import ParameterError
from tactile_localizer.io.bags.topics import BagTopics
from tactile_localizer.io.csv.columns import ColumnNaming, load_naming, naming_from_pairs
from tactile_localizer.io.strain_adapter import load_adapter
from tactile_localizer.resources import given_or_shipped
from tactile_localizer.scene import Scene

_TOPIC_HELP = {
    "strain": "strain vectors",
    "pose": "measured palm poses",
    "truth": "true palm poses",
    "status": "status of the mapping node, for its sweeps",
    "posterior": "posterior of the filter node, for global localizations",
}


def add_csv_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options for CSV files: column names, speed."""
    group = parser.add_argument_group("CSV files")
    group.add_argument(
        "--columns", metavar="YAML", help="column naming, if columns do not have the standard names"
    )
    group.add_argument(
        "--column",
        action="append",
        default=[],
        metavar="NAME=COLUMN",
        help="name of a column: stamp_s=time_ms*0.001, index=gauge1..8 (repeatable)",
    )
    group.add_argument(
        "--speed",
        action="append",
        default=[],
        metavar="[AXIS=]M_PER_S",
        help="constant speed, m/s, if positions were not recorded",
    )


def add_bag_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options for bags: topics, frames, gaps."""
    group = parser.add_argument_group("bags")
    for name, topic in vars(BagTopics()).items():
        text = f"{_TOPIC_HELP[name]} (default: {topic})"
        group.add_argument(f"--{name}-topic", default=topic, metavar="TOPIC", help=text)
    group.add_argument(
        "--adapter",
        metavar="YAML",
        help="adapter from other messages to strain (docs/sensors.md): a file, or the name of a shipped one",
    )
    group.add_argument(
        "--material-frame", default="material", metavar="FRAME", help="frame of poses that need no transform"
    )
    group.add_argument(
        "--reference-frame",
        default="base_link",
        metavar="FRAME",
        help="frame of poses to transform by --material-pose",
    )
    group.add_argument(
        "--material-pose",
        type=float,
        nargs=6,
        default=[0.0] * 6,
        metavar=("X", "Y", "Z", "ROLL", "PITCH", "YAW"),
        help="pose of the material in the reference frame, m and rad",
    )
    group.add_argument(
        "--max-gap",
        type=float,
        default=DEFAULT_MAX_GAP_S,
        metavar="S",
        help="largest gap between poses that is interpolated, s",
    )


def bag_options(args: argparse.Namespace, scene: Scene) -> dict[str, Any]:
    """Arguments of :func:`read_bag` from the options of ``add_bag_arguments``."""
    topics = {name: getattr(args, f"{name}_topic") for name in vars(BagTopics())}
    frame = PalmFrame(scene.axes, args.material_frame, args.reference_frame, args.material_pose)
    adapter = load_adapter(given_or_shipped(args.adapter, "config/adapters")) if args.adapter else None
    return {"topics": BagTopics(**topics), "frame": frame, "max_gap_s": args.max_gap, "adapter": adapter}


def naming_from_arguments(args: argparse.Namespace, scene: Scene) -> ColumnNaming:
    """The column naming of ``--columns``, ``--column`` and ``--speed``.

    Raises
    ------
    ParameterError
        A speed is not a number, or names no axis although the scene has several.
    """
    base = load_naming(given_or_shipped(args.columns, "config/import")) if args.columns else ColumnNaming()
    naming = naming_from_pairs(args.column, base)
    return replace(naming, speed={**naming.speed, **_speeds(args.speed, scene)})


def _speeds(texts: Sequence[str], scene: Scene) -> dict[str, float]:
    speeds = {}
    for text in texts:
        axis, equals, value = text.rpartition("=")
        if not equals and scene.dimension > 1:
            raise ParameterError(
                f"speed {text!r}: expected AXIS=M_PER_S, the scene has {scene.dimension} axes"
            )
        try:
            speed = float(value)
        except ValueError:
            speed = math.nan
        if not math.isfinite(speed):
            raise ParameterError(f"speed {text!r}: expected a finite number of m/s")
        speeds[axis or scene.axis_names[0]] = speed
    return speeds
