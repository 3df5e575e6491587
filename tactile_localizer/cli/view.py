"""``tactile-localizer view``: replay into the Rerun viewer."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from tactile_localizer.cli.progress import progress_bars
from tactile_localizer.cli.recordings import (
    add_configuration_arguments,
    add_recording_arguments,
    add_scan_arguments,
    configuration_from_arguments,
    odometry_of,
    read_recordings,
    scan_from_arguments,
)
from tactile_localizer.cli.seeds import add_seed_argument
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.io.scans.learned import learned_calibration
from tactile_localizer.offline.odometry import RECORDED, with_odometry
from tactile_localizer.offline.rerun_recording import ReplayView


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    add_recording_arguments(parser)
    add_scan_arguments(parser)
    add_configuration_arguments(parser)
    add_seed_argument(parser)
    parser.add_argument(
        "--save", type=Path, metavar="FILE", help="write the view into a file (*.rrd) instead of opening it"
    )


def run(args: argparse.Namespace) -> int:
    """Replay into the viewer, or into a file for it."""
    scan, scene = scan_from_arguments(args)
    configuration = configuration_from_arguments(args)
    recording, true_positions = read_recordings(args, scene)
    odometry = odometry_of(args, true_positions)
    if odometry != RECORDED:
        recording = with_odometry(recording, scene, np.random.default_rng([args.seed, 1]), odometry)
    view = ReplayView(scan, scene, args.save)
    with progress_bars() as progress:
        calibration = learned_calibration(Path(args.scan), scan, scene, progress)
        rng = np.random.default_rng(args.seed)
        localizer = build_localizer(scan, scene, configuration, rng, progress, calibration)
        written = view.replay(localizer, recording, progress)
    where = f"{args.save}: open it with `rerun {args.save}`" if args.save else "in the viewer"
    print(f"{len(recording.sweeps)} sweeps, {written} updates, {where}")
    return 0
