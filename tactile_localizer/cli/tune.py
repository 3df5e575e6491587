"""``tactile-localizer tune``: the measurement model's parameters chosen by data and written into a scene."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from tactile_localizer.cli.progress import progress_bars
from tactile_localizer.cli.recordings import add_scan_arguments, scan_from_arguments
from tactile_localizer.cli.tables import print_tables
from tactile_localizer.core.factory import with_parameters
from tactile_localizer.core.likelihood.neighbours import search_neighbours
from tactile_localizer.core.selection import best_of, search
from tactile_localizer.evaluation.report import save_figures
from tactile_localizer.evaluation.tuning import (
    best_neighbours,
    neighbours_table,
    tuning_figure,
    tuning_table,
)
from tactile_localizer.io.scans.learned import completed_scene
from tactile_localizer.io.scene_file import save_scene

NAME = "tune"
HELP = "choose the measurement model's parameters by what localises held-out sweeps"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the scan and the scene to write."""
    add_scan_arguments(parser)
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="SCENE",
        help="scene to write, a picture beside it (default: choose for the filter, kept in the scan)",
    )


def run(args: argparse.Namespace) -> int:
    """Search, show the curve, write scene and picture; or choose, and keep the choice in the scan file."""
    scan, scene = scan_from_arguments(args)
    if args.output is None:
        with progress_bars() as progress:
            completed_scene(Path(args.scan), scan, scene, progress)
        print(f"{args.scan}: chosen, for the filter's next start")
        return 0
    with progress_bars() as progress:
        trials = search(scan, scene, progress)
        by_neighbours = search_neighbours(scan, scene, progress)
    print_tables([tuning_table(trials, scene.axis_names), neighbours_table(by_neighbours)])
    pictures = save_figures({args.output.stem: tuning_figure(trials, by_neighbours)}, args.output.parent)
    chosen = replace(best_of(trials).for_whole_scan, neighbours=best_neighbours(by_neighbours).neighbours)
    save_scene(with_parameters(scene, chosen), args.output)
    print(f"{args.output}, {pictures[0]}")
    return 0
