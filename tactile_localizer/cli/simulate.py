"""``tactile-localizer simulate``: recordings of the simulated hand."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from tactile_localizer.cli.seeds import add_seed_argument
from tactile_localizer.errors import ScanError
from tactile_localizer.io.csv.columns import channel_names
from tactile_localizer.io.scene_file import load_scene, save_scene
from tactile_localizer.io.whole_file import whole_file
from tactile_localizer.resources import resource_path
from tactile_localizer.scene import Scene
from tactile_localizer.sim.hand import PHALANGES
from tactile_localizer.sim.material import FEATURES, SIMULATED_FEATURES
from tactile_localizer.sim.scan import AXES, TEST_SWEEPS, TRAINING_SWEEPS, SimulatedScan, simulate_scan


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the feature, the seed and the numbers of sweeps."""
    parser.add_argument(
        "feature",
        choices=FEATURES,
        help="feature in the material (none: featureless material; seam has no shipped scene)",
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("out/simulate"),
        metavar="DIR",
        help="folder (default out/simulate)",
    )
    add_seed_argument(parser)
    parser.add_argument(
        "--train",
        type=int,
        default=TRAINING_SWEEPS,
        metavar="N",
        help=f"training sweeps (default {TRAINING_SWEEPS})",
    )
    parser.add_argument(
        "--test", type=int, default=TEST_SWEEPS, metavar="N", help=f"test sweeps (default {TEST_SWEEPS})"
    )
    parser.add_argument(
        "--channels",
        type=int,
        nargs=2,
        default=(),
        metavar="N",
        help="channels of the two phalanges (default: 8 each); also writes scene.yaml",
    )
    parser.add_argument("--never-reach", action="store_true", help="end the test sweeps before the feature")


def run(args: argparse.Namespace) -> int:
    """Write the training sweeps with the arm's positions, and the test sweeps with the true ones."""
    channels = tuple(args.channels)
    train = simulate_scan(args.feature, args.seed, "train", sweeps=args.train, channels=channels)
    test = simulate_scan(
        args.feature,
        args.seed,
        "test",
        sweeps=args.test,
        reach_feature=not args.never_reach,
        channels=channels,
    )
    for name, scan, position in (("train", train, train.odometry), ("test", test, test.truth)):
        path = args.output / f"{name}.csv"
        write_csv(path, scan, position)
        print(f"{path}: {len(scan.contact)} sweeps, {len(scan)} samples")
    if channels:
        path = args.output / "scene.yaml"
        save_scene(_scene(args.feature, channels), path)
        print(f"{path}: the scene, with {channels[0]} and {channels[1]} channels")
    return 0


def _scene(feature: str, channels: tuple[int, ...]) -> Scene:
    """The shipped scene of a feature (default: the bump) with other channels, without kernel widths."""
    name = feature if feature in SIMULATED_FEATURES else SIMULATED_FEATURES[0]
    shipped = load_scene(resource_path(f"config/scenes/{name}.yaml"))
    phalanges = tuple(
        replace(phalanx, channels=count) for phalanx, count in zip(shipped.phalanges, channels, strict=True)
    )
    return replace(shipped, name=feature, phalanges=phalanges, measurement={})


def write_csv(path: Path, scan: SimulatedScan, position: np.ndarray) -> None:
    """Write simulated sweeps in the standard columns.

    Parameters
    ----------
    path : CSV file
    scan : simulated sweeps, N samples
    position : (N, 2) positions to write, m

    Raises
    ------
    ScanError
        The file cannot be written.
    """
    counts = zip(PHALANGES, scan.layout.counts, strict=True)
    strain_names = [column for name, channels in counts for column in channel_names(name, channels)]
    header = ",".join(["stamp_s", "sweep", *AXES, *strain_names, "felt"])
    table = np.column_stack([scan.stamp_ns * 1e-9, scan.sweep, position, scan.strain, scan.felt])
    formats = ["%.9f", "%d", *["%.7f"] * len(AXES), *["%.6f"] * len(strain_names), "%d"]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as unfinished:
            np.savetxt(unfinished, table, formats, delimiter=",", header=header, comments="")
    except OSError as error:
        raise ScanError(f"{path}: expected to write a recording, {error.strerror}") from error
