"""``tactile-localizer import``: recordings in CSV files or bags into a scan file."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence

from tactile_localizer.cli.files import given_or_shipped
from tactile_localizer.errors import ParameterError
from tactile_localizer.io.csv_columns import ColumnNaming, load_naming, naming_from_pairs
from tactile_localizer.io.csv_recording import read_csv
from tactile_localizer.io.scan_import import ImportReport, import_recording
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.scene import Scene

NAME = "import"
HELP = "make a scan file of recordings"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare ``import csv`` and ``import bag``."""
    kinds = parser.add_subparsers(dest="kind", required=True, metavar="KIND")
    from_csv = kinds.add_parser("csv", help="one or more CSV files")
    add_csv_arguments(from_csv)
    for kind in (from_csv,):
        kind.add_argument("--scene", required=True, help="scene file (YAML), or the name of a shipped one")
        kind.add_argument("-o", "--output", required=True, metavar="SCAN", help="scan file to make")


def add_csv_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what any command that reads CSV recordings needs: files, column names, speed."""
    parser.add_argument("files", nargs="+", metavar="FILE", help="one sweep each, unless a column says which")
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
    """Import and say what was kept and what was left out."""
    scene = load_scene(given_or_shipped(args.scene, "config/scenes"))
    naming = naming_from_arguments(args)
    speeds = speed_from_arguments(args.speed, scene)
    recording = read_csv(args.files, scene, naming, speeds)
    report = import_recording(
        recording,
        scene,
        args.output,
        what="import csv",
        detail={"files": args.files, "speed": speeds},
        strain_unit=naming.strain_unit,
    )
    _say(args.output, report)
    return 0


def _say(path: str, report: ImportReport) -> None:
    print(f"{path}: {report.sweeps} sweeps, {report.pairs} pairs")
    for note in report.notes:
        print(f"  {note}")
