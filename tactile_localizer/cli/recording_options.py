"""Command-line options for reading recordings: columns of CSV files, topics and frames of bags."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any

from tactile_localizer.core.geometry.palm_frame import PalmFrame
from tactile_localizer.core.geometry.synchronization import DEFAULT_MAX_GAP_S
from tactile_localizer.errors import ParameterError
from tactile_localizer.io.bags.sweeps import TOPICS
from tactile_localizer.io.csv.columns import ColumnNaming, load_naming, naming_from_dict, naming_from_pairs
from tactile_localizer.io.strain_adapter import load_adapter
from tactile_localizer.quantity import number
from tactile_localizer.resources import given_or_shipped
from tactile_localizer.scene import Scene


def add_csv_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options for CSV files: column names, separate poses."""
    add = parser.add_argument_group("CSV files").add_argument
    add("--columns", metavar="YAML", help="column naming, if columns do not have the standard names")
    text = "name of a column: stamp_s=time_ms*0.001, index=gauge1..8 (repeatable)"
    add("--column", action="append", default=[], metavar="NAME=COLUMN", help=text)
    text = "file of palm positions with their own stamps, interpolated at those of the strain (repeatable)"
    add("--poses", action="append", default=[], metavar="FILE", help=text)


def add_bag_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options for bags: topics, frames, adapter."""
    add = parser.add_argument_group("bags").add_argument
    for name, (topic, text) in TOPICS.items():
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
    parser.add_argument("--max-gap", type=_seconds, default=DEFAULT_MAX_GAP_S, metavar="S", help=text)


def bag_options(args: argparse.Namespace, scene: Scene) -> dict[str, Any]:
    """Arguments of :func:`read_bag` from the options of ``add_bag_arguments``."""
    topics = {name: getattr(args, f"{name}_topic") for name in TOPICS}
    frame = PalmFrame(scene.axes, args.material_frame, args.reference_frame, args.material_pose)
    adapter = load_adapter(given_or_shipped(args.adapter, "config/adapters")) if args.adapter else None
    return {"topics": topics, "frame": frame, "max_gap_s": args.max_gap, "adapter": adapter}


def naming_from_arguments(
    args: argparse.Namespace, imported: Mapping[str, Any] | None = None
) -> ColumnNaming:
    """The column naming of ``--columns`` and ``--column``.

    Parameters
    ----------
    args : the command line
    imported : naming that the scan was imported with, in its YAML form; replaced by ``--columns``
    """
    base = naming_from_dict(imported or {})
    if args.columns:
        base = load_naming(given_or_shipped(args.columns, "config/import"))
    return naming_from_pairs(args.column, base)


def _seconds(text: str) -> float:
    try:
        return number(float(text), "seconds", lower=0.0)
    except (ValueError, ParameterError) as error:
        raise argparse.ArgumentTypeError(str(error)) from None
