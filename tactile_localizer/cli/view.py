"""``tactile-localizer view``: a replay in the Rerun viewer."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
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
from tactile_localizer.errors import ParameterError
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
    """Write a replay to a file, and show it in the viewer unless ``--save`` names the file."""
    if args.save is not None:
        _write(args, args.save)
        print(f"{args.save}: open it with `rerun {args.save}`")
        return 0
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise ParameterError(
            "viewer: expected a display (DISPLAY or WAYLAND_DISPLAY), found none; --save FILE writes a file "
            "to open on another machine"
        )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "replay.rrd"
        _write(args, path)
        # The viewer also serves; only this machine may connect.
        command = [sys.executable, "-m", "rerun", "--bind", "127.0.0.1", str(path)]
        return subprocess.run(command, check=False).returncode


def _write(args: argparse.Namespace, path: Path) -> None:
    scan, scene = scan_from_arguments(args)
    recording, _ = odometry_from_arguments(args, scene, args.recordings)
    with progress_bars() as progress:
        localizer, _ = localizer_from_arguments(args, scan, scene, progress)
        written = ReplayView(scan, localizer, path).replay(recording, progress)
    print(f"{len(recording.sweeps)} sweeps, {written} updates")
