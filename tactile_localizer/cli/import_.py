"""``tactile-localizer import``: recordings in CSV files or bags into a scan file."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from typing import Any

from tactile_localizer.core.palm_frame import PalmFrame
from tactile_localizer.core.pose_buffer import DEFAULT_MAX_GAP_S
from tactile_localizer.core.sweep_detector import SweepDetector
from tactile_localizer.errors import ParameterError
from tactile_localizer.io.bag_recording import BagTopics, read_bag
from tactile_localizer.io.csv_columns import ColumnNaming, load_naming, naming_from_pairs
from tactile_localizer.io.csv_recording import read_csv
from tactile_localizer.io.recording import Recording, join
from tactile_localizer.io.scan_import import import_recording
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.resources import given_or_shipped
from tactile_localizer.scene import Scene

NAME = "import"
HELP = "make a scan file of recordings"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare ``import csv`` and ``import bag``."""
    kinds = parser.add_subparsers(dest="kind", required=True, metavar="KIND")
    from_csv = kinds.add_parser("csv", help="one or more CSV files")
    from_csv.add_argument(
        "files", nargs="+", metavar="FILE", help="one sweep each, unless a column says which"
    )
    add_csv_arguments(from_csv)
    from_bag = kinds.add_parser(
        "bag", help="one or more bags: SQLite or MCAP, directory or file, compressed too"
    )
    from_bag.add_argument("files", nargs="+", metavar="BAG", help="directory, *.mcap or *.db3")
    add_bag_arguments(from_bag)
    from_bag.add_argument(
        "--detect-sweeps",
        choices=("both_ways", "one_way"),
        help="find the sweeps in the motion; one_way: without the returns (default: the mapping node's)",
    )
    for kind in (from_csv, from_bag):
        kind.add_argument("--scene", required=True, help="scene file (YAML), or the name of a shipped one")
        kind.add_argument("-o", "--output", required=True, metavar="SCAN", help="scan file to make")


def add_csv_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what any command that reads CSV recordings needs: column names, speed."""
    parser.add_argument(
        "--columns", metavar="YAML", help="names of the columns, where they are not the standard ones"
    )
    parser.add_argument(
        "--column",
        action="append",
        default=[],
        metavar="NAME=COLUMN",
        help="one such name: stamp_s=time_ms*0.001, index=gauge1..8 (repeatable)",
    )
    parser.add_argument(
        "--speed",
        action="append",
        default=[],
        metavar="[AXIS=]M_PER_S",
        help="position from constant speed, m/s",
    )


def add_bag_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what any command that reads bags needs: topics, frames, gaps."""
    for name, topic in vars(BagTopics()).items():
        parser.add_argument(f"--{name}-topic", default=topic, metavar="TOPIC", help=f"(default: {topic})")
    parser.add_argument(
        "--material-frame", default="material", metavar="FRAME", help="frame of poses taken as they are"
    )
    parser.add_argument(
        "--reference-frame", default="base", metavar="FRAME", help="frame of poses moved by --material-pose"
    )
    parser.add_argument(
        "--material-pose",
        type=float,
        nargs=6,
        default=[0.0] * 6,
        metavar=("X", "Y", "Z", "ROLL", "PITCH", "YAW"),
        help="where the material is in the reference frame, m and rad",
    )
    parser.add_argument(
        "--max-gap",
        type=float,
        default=DEFAULT_MAX_GAP_S,
        metavar="S",
        help="poses further apart are not interpolated",
    )


def bag_options(args: argparse.Namespace, scene: Scene) -> dict[str, Any]:
    """The options of :func:`read_bag` that ``add_bag_arguments`` has declared."""
    topics = {name: getattr(args, f"{name}_topic") for name in vars(BagTopics())}
    frame = PalmFrame(scene.axes, args.material_frame, args.reference_frame, args.material_pose)
    return {"topics": BagTopics(**topics), "frame": frame, "max_gap_s": args.max_gap}


def naming_from_arguments(args: argparse.Namespace) -> ColumnNaming:
    """The column naming of ``--columns`` and ``--column``."""
    base = load_naming(given_or_shipped(args.columns, "config/import")) if args.columns else ColumnNaming()
    return naming_from_pairs(args.column, base)


def speed_from_arguments(texts: Sequence[str], scene: Scene) -> dict[str, float]:
    """The speeds of ``--speed``, by axis, m/s.

    Raises
    ------
    ParameterError
        A speed is not a number, or names no axis in a scene of several.
    """
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


def run(args: argparse.Namespace) -> int:
    """Import, and say what was kept and what was left out."""
    scene = load_scene(given_or_shipped(args.scene, "config/scenes"))
    read = _read_csv if args.kind == "csv" else _read_bags
    recording, detail, unit = read(args, scene)
    detail = {"files": args.files, **detail}
    report = import_recording(
        recording, scene, args.output, what=f"import {args.kind}", detail=detail, strain_unit=unit
    )
    print(f"{args.output}: {report.sweeps} sweeps, {report.pairs} pairs")
    for note in report.notes:
        print(f"  {note}")
    return 0


def _read_csv(args: argparse.Namespace, scene: Scene) -> tuple[Recording, dict[str, Any], str]:
    naming = naming_from_arguments(args)
    speeds = speed_from_arguments(args.speed, scene)
    return read_csv(args.files, scene, naming, speeds), {"speed": speeds}, naming.strain_unit


def _read_bags(args: argparse.Namespace, scene: Scene) -> tuple[Recording, dict[str, Any], str]:
    options = bag_options(args, scene)
    recordings = []
    for file in args.files:
        detector = None
        if args.detect_sweeps:
            detector = SweepDetector(scene.axes, one_way=args.detect_sweeps == "one_way")
        recordings.append(read_bag(file, scene, detector=detector, **options))
    return join(recordings), {"detect_sweeps": args.detect_sweeps}, "V"
