"""``tactile-localizer import``: make a scan from CSV files or bags."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from tactile_localizer.cli.recording_options import (
    add_bag_arguments,
    add_csv_arguments,
    add_gap_argument,
    bag_options,
    naming_from_arguments,
)
from tactile_localizer.core.geometry.motion import levers
from tactile_localizer.core.scan.sweep_detector import SweepDetector
from tactile_localizer.errors import SceneError
from tactile_localizer.io.csv.columns import ColumnNaming, MissingColumnError, naming_to_dict
from tactile_localizer.io.csv.proposal import propose_scene
from tactile_localizer.io.csv.recording import read_csv
from tactile_localizer.io.recording import Recording, join
from tactile_localizer.io.scans.importer import import_recording
from tactile_localizer.io.scene_file import load_scene, save_scene
from tactile_localizer.library import load_scan
from tactile_localizer.offline.scan_quality import copied_sweeps
from tactile_localizer.resources import given_or_shipped
from tactile_localizer.scene import Scene

_CELL_M = 0.002
"""Size of the smallest cells of a map, m; rougher scans have larger ones."""

_BOUNDS_RATIO = 10.0
"""Bounds that are so many times larger than what the recording covers are reported (judgement)."""

_LEAST_COVERED = 0.005
"""What a recording is taken to cover at least on an axis, m or rad: a single line has no width."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare ``import csv`` and ``import bag``."""
    kinds = parser.add_subparsers(dest="kind", required=True, metavar="KIND")
    from_csv = kinds.add_parser("csv", help="one or more CSV files")
    from_csv.add_argument(
        "files", nargs="+", metavar="FILE", help="one sweep per file, unless a column has the sweep numbers"
    )
    add_csv_arguments(from_csv)
    from_bag = kinds.add_parser("bag", help="one or more bags: SQLite or MCAP, directory or file")
    from_bag.add_argument("files", nargs="+", metavar="BAG", help="directory, *.mcap or *.db3")
    add_bag_arguments(from_bag)
    from_bag.add_argument(
        "--detect-sweeps",
        choices=("both_ways", "one_way"),
        help="detect sweeps in the motion; one_way: without the return strokes (default: as recorded by the "
        "mapping node)",
    )
    for kind, proposed in ((from_csv, " (default: a proposed one, written beside the scan)"), (from_bag, "")):
        add_gap_argument(kind)
        kind.add_argument(
            "--scene",
            required=not proposed,
            help=f"scene file (YAML), or the name of a shipped one{proposed}",
        )
        kind.add_argument(
            "-o", "--output", required=True, metavar="SCAN", help="folder of the scan to create"
        )
        kind.add_argument(
            "--force", action="store_true", help="import even if less than half of the samples are usable"
        )


def run(args: argparse.Namespace) -> int:
    """Import, and print the numbers of sweeps, pairs and skipped samples."""
    scene = load_scene(given_or_shipped(args.scene, "config/scenes")) if args.scene else None
    unit, detail = "V", {"files": args.files}
    if args.kind == "csv":
        naming = naming_from_arguments(args, scene)
        unit = naming.strain_unit
        detail |= {"columns": naming_to_dict(naming), "poses": args.poses}
        try:
            scene = scene or _proposed(args, naming)
            recording = read_csv(args.files, scene, naming, poses=args.poses, max_gap_s=args.max_gap)
        except MissingColumnError as error:
            print(error.template)
            raise
    else:
        assert scene is not None
        detail |= {"detect_sweeps": args.detect_sweeps}
        recording = join([_read_bag(file, args, scene) for file in args.files])
    scene.cells(_CELL_M / levers(scene))
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
    copies = copied_sweeps(load_scan(args.output)[0])
    for note in (*report.notes, *_wide_bounds(scene, recording), *copies):
        print(f"  {note}")
    return 0


def _proposed(args: argparse.Namespace, naming: ColumnNaming) -> Scene:
    """Propose a scene, write it and print what was assumed."""
    scene, assumptions = propose_scene(Path(args.output).name, args.files, naming, args.poses)
    path = Path(f"{args.output}.scene.yaml")
    if path.exists():
        raise SceneError(
            f"{path}: expected no file; pass it by --scene {path}, or remove it for a new proposal"
        )
    save_scene(scene, path)
    print(f"{path}: a proposed scene; correct it and import again with --scene {path} if this is wrong:")
    for line in assumptions:
        print(f"  {line}")
    return scene


def _read_bag(file: str, args: argparse.Namespace, scene: Scene) -> Recording:
    # Imported here because rosbags takes 0.3 s, which CSV files do not need.
    from tactile_localizer.io.bags.recording import read_bag

    one_way = args.detect_sweeps == "one_way"
    detector = SweepDetector(scene.axes, one_way=one_way) if args.detect_sweeps else None
    return read_bag(file, scene, detector=detector, **bag_options(args, scene))


def _wide_bounds(scene: Scene, recording: Recording) -> Iterator[str]:
    """A warning for each axis whose bounds are many times larger than what the recording covers."""
    position = np.concatenate([sweep.position for sweep in recording.sweeps])
    covered = np.maximum(np.ptp(position, axis=0), _LEAST_COVERED)
    for axis, span in zip(scene.axes, covered.tolist(), strict=True):
        if axis.extent > _BOUNDS_RATIO * span and not axis.wraps:
            yield (
                f"warning: the bounds of {axis.name} are {axis.extent:.4g} long, the recording covers "
                f"{span:.4g} (in mm?)"
            )
