"""``tactile-localizer identify``: identification of the scan that a recording belongs to."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from tactile_localizer.cli.progress import progress_bars
from tactile_localizer.cli.recordings import (
    add_configuration_arguments,
    add_recording_arguments,
    configuration_from_arguments,
    odometry_from_arguments,
)
from tactile_localizer.cli.seeds import add_seed_argument
from tactile_localizer.cli.tables import print_tables
from tactile_localizer.core.factory import build_identifier
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import ParameterError, ScanError
from tactile_localizer.io.scans.folder import ScanFolder
from tactile_localizer.offline.identification import (
    identification_figure,
    identification_table,
    identify,
    travel_table,
)
from tactile_localizer.scene import Scene


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    add_recording_arguments(parser)
    parser.add_argument(
        "--scan", action="append", required=True, metavar="SCAN", help="scan of a candidate (repeatable)"
    )
    add_configuration_arguments(parser)
    add_seed_argument(parser)
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("out/identify.png"),
        metavar="FILE",
        help="figure of the probabilities along the travel (default: out/identify.png)",
    )


def run(args: argparse.Namespace) -> int:
    """Identify the scan of each sweep; print the probabilities at its end and draw them along it."""
    candidates = _candidates(args.scan)
    scene = next(iter(candidates.values()))[1]
    recording = odometry_from_arguments(args, scene).recording
    with progress_bars() as progress:
        rng = np.random.default_rng(args.seed)
        identifier = build_identifier(candidates, configuration_from_arguments(args), rng, progress)
        sweeps = identify(identifier, scene, recording, progress)
    for note in recording.notes:
        print(f"note: {note}")
    print_tables([travel_table(sweeps), identification_table(sweeps)])
    title = f"identification of {Path(args.recordings[0]).name}"
    try:
        args.output.parent.mkdir(parents=True, exist_ok=True)
        identification_figure(sweeps, title).savefig(args.output, dpi=110)
    except (OSError, ValueError) as error:
        raise ScanError(f"{args.output}: expected to write a figure, {error}") from None
    print(f"{args.output}: the probabilities along the travel")
    return 0


def _candidates(paths: list[str]) -> dict[str, tuple[Scan, Scene]]:
    """Scans with their scenes, by scene name, or by file name where scene names are equal."""
    loaded = []
    for path in paths:
        folder = ScanFolder(path)
        loaded.append((Path(path), folder.load(), folder.scene))
    names = [scene.name for _, _, scene in loaded]
    if len(set(names)) < len(names):
        names = [path.stem for path, _, _ in loaded]
    if len(set(names)) < len(names):
        raise ParameterError(f"--scan: expected scans of different names, got {', '.join(names)}")
    first = loaded[0][2]
    for other, _, scene in loaded[1:]:
        layout = (scene.axis_names, scene.phalanx_names, scene.layout.counts)
        if layout != (first.axis_names, first.phalanx_names, first.layout.counts):
            raise ParameterError(
                f"{other}: expected the axes, phalanges and channels of {loaded[0][0]}, found others"
            )
    return {name: (scan, scene) for name, (_, scan, scene) in zip(names, loaded, strict=True)}
