"""``tactile-localizer import``: make a scan from CSV files or bags."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import yaml

from tactile_localizer.cli.recording_options import (
    add_bag_arguments,
    add_csv_arguments,
    bag_options,
    naming_from_arguments,
)
from tactile_localizer.cli.tables import print_tables
from tactile_localizer.core.scan.sweep_detector import SweepDetector
from tactile_localizer.errors import ScanError
from tactile_localizer.io.bags.recording import read_bag
from tactile_localizer.io.csv.columns import naming_to_dict
from tactile_localizer.io.csv.guess import Guess, guess_columns
from tactile_localizer.io.csv.recording import read_csv
from tactile_localizer.io.recording import Recording, join
from tactile_localizer.io.scans.importer import import_recording
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.io.whole_file import whole_file
from tactile_localizer.offline.table import Table
from tactile_localizer.resources import given_or_shipped
from tactile_localizer.scene import Scene


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare ``import csv`` and ``import bag``."""
    kinds = parser.add_subparsers(dest="kind", required=True, metavar="KIND")
    from_csv = kinds.add_parser("csv", help="one or more CSV files")
    from_csv.add_argument(
        "files", nargs="+", metavar="FILE", help="one sweep per file, unless a column has the sweep numbers"
    )
    add_csv_arguments(from_csv)
    from_bag = kinds.add_parser(
        "bag", help="one or more bags: SQLite or MCAP, directory or file, also compressed"
    )
    from_bag.add_argument("files", nargs="+", metavar="BAG", help="directory, *.mcap or *.db3")
    add_bag_arguments(from_bag)
    from_bag.add_argument(
        "--detect-sweeps",
        choices=("both_ways", "one_way"),
        help="detect sweeps in the motion; one_way: without the return strokes (default: as recorded by the "
        "mapping node)",
    )
    for kind in (from_csv, from_bag):
        kind.add_argument("--scene", required=True, help="scene file (YAML), or the name of a shipped one")
        kind.add_argument(
            "-o", "--output", required=True, metavar="SCAN", help="folder of the scan to create"
        )
        kind.add_argument(
            "--force", action="store_true", help="import even if less than half of the samples are usable"
        )


def run(args: argparse.Namespace) -> int:
    """Import, and print the numbers of sweeps, pairs and skipped samples."""
    scene = load_scene(given_or_shipped(args.scene, "config/scenes"))
    read = _read_csv if args.kind == "csv" else _read_bags
    recording, detail, unit = read(args, scene)
    detail = {"files": args.files, **detail}
    report = import_recording(
        recording,
        scene,
        args.output,
        what=f"import {args.kind}",
        detail=detail,
        strain_unit=unit,
        force=args.force,
    )
    print(f"{args.output}: {report.sweeps} sweeps, {report.pairs} pairs")
    for note in report.notes:
        print(f"  {note}")
    return 0


def _read_csv(args: argparse.Namespace, scene: Scene) -> tuple[Recording, dict[str, Any], str]:
    naming = naming_from_arguments(args, scene)
    naming.check(scene)
    guess = guess_columns(args.files[0], scene, naming)
    if guess.guessed:
        _print_guess(guess, scene, args)
    recording = read_csv(args.files, scene, guess.naming)
    return recording, {"speed": dict(guess.naming.speed)}, guess.naming.strain_unit


def _print_guess(guess: Guess, scene: Scene, args: argparse.Namespace) -> None:
    """Print the guessed columns and write them to a file for reuse."""
    rows = []
    for quantity, why in guess.guessed.items():
        speed = guess.naming.speed.get(quantity)
        if quantity in guess.naming.columns:
            columns = guess.naming.columns[quantity]
            first, last = columns.names[0], columns.names[-1]
            names = first if len(columns.names) == 1 else f"{first} to {last} ({len(columns.names)})"
            rows.append([quantity, names, f"{columns.scale}", why])
        else:
            rows.append([quantity, f"{speed:g} m/s x time", "", why])
    print_tables(
        [Table(f"{args.files[0]}: guessed columns", ["quantity", "columns", "factor", "reason"], rows)]
    )
    path = Path(args.output).with_suffix(".columns.yaml")
    content = yaml.safe_dump(
        naming_to_dict(guess.naming), sort_keys=False, default_flow_style=None, width=100
    )
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as unfinished:
            unfinished.write_text(f"# Guessed columns of {Path(args.files[0]).name}: check them.\n{content}")
    except OSError as error:
        raise ScanError(f"{path}: expected to write the columns, {error.strerror}") from None
    print(f"{path}: the guessed columns; if they are wrong, correct them and pass --columns {path}")


def _read_bags(args: argparse.Namespace, scene: Scene) -> tuple[Recording, dict[str, Any], str]:
    options = bag_options(args, scene)
    recordings = []
    for file in args.files:
        detector = None
        if args.detect_sweeps:
            detector = SweepDetector(scene.axes, one_way=args.detect_sweeps == "one_way")
        recordings.append(read_bag(file, scene, detector=detector, **options))
    return join(recordings), {"detect_sweeps": args.detect_sweeps}, "V"
