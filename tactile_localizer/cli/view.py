"""``tactile-localizer view``: a replay in the Rerun viewer."""

from __future__ import annotations

import argparse
from pathlib import Path

from tactile_localizer.cli.progress import progress_bars
from tactile_localizer.cli.recordings import (
    add_configuration_arguments,
    add_recording_arguments,
    add_scan_arguments,
    localizer_from_arguments,
    odometry_from_arguments,
    scan_from_arguments,
)
from tactile_localizer.cli.seeds import add_seed_argument
from tactile_localizer.offline.rerun_recording import ReplayView


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    add_scan_arguments(parser)
    add_configuration_arguments(parser)
    add_seed_argument(parser)
    add_recording_arguments(parser)
    parser.add_argument(
        "--save", type=Path, metavar="FILE", help="write a file (*.rrd) instead of opening the viewer"
    )


def run(args: argparse.Namespace) -> int:
    """Write a replay to the viewer, or to a file that it opens."""
    scan, scene = scan_from_arguments(args)
    recording = odometry_from_arguments(args, scene).recording
    view = ReplayView(scan, scene, args.save)
    with progress_bars() as progress:
        localizer, _ = localizer_from_arguments(args, scan, scene, progress)
        written = view.replay(localizer, recording, progress)
    where = f"{args.save}: open it with `rerun {args.save}`" if args.save else "in the viewer"
    print(f"{len(recording.sweeps)} sweeps, {written} updates, {where}")
    return 0
