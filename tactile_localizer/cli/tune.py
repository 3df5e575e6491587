"""``tactile-localizer tune``: noise model and calibration of a scan."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from tactile_localizer.cli.progress import progress_bars
from tactile_localizer.cli.recordings import add_scan_arguments, scan_from_arguments
from tactile_localizer.cli.tables import print_tables
from tactile_localizer.core.calibration.kernel_widths import choose_kernel_widths
from tactile_localizer.core.calibration.sweep_model import learn_sweep_model
from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.parameters import ModelParameters
from tactile_localizer.io.scans.folder import ScanFolder
from tactile_localizer.io.scans.learned import learned_calibration
from tactile_localizer.io.scene_file import save_scene
from tactile_localizer.offline.reports.learned import (
    learned_table,
    noise_table,
    widths_table,
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the scan and the scene to write."""
    add_scan_arguments(parser)
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="SCENE",
        help="write the scene with parameters for the kernel and Gaussian models, chosen from the scan; the "
        "default model needs none",
    )


def run(args: argparse.Namespace) -> int:
    """Learn from the scan, print the result, and with ``--output`` write a scene."""
    scan, scene = scan_from_arguments(args)
    unit = ScanFolder(args.scan).sweeps()[0].strain_unit
    with progress_bars() as progress:
        calibration = learned_calibration(Path(args.scan), scan, scene, progress)
        model = learn_sweep_model(scan, scene)
    mixture = model.mixture(scene, Configuration().cell, calibration.information_length)
    print_tables([learned_table(scene, mixture, calibration), noise_table(scene, model, unit)])
    print(f"{args.scan}: stored for the next start of replay and of the filter node")
    if args.output is None:
        return 0
    chosen = choose_kernel_widths(scan, scene, ModelParameters())
    print_tables([widths_table(scene, chosen, unit)])
    save_scene(replace(scene, measurement=chosen.to_mapping()), args.output)
    print(args.output)
    return 0
