"""``tactile-localizer simulate``: recordings of the simulated hand."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tactile_localizer.cli.seeds import add_seed_argument
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
    add, folder = parser.add_argument, Path("out/simulate")
    add("feature", choices=FEATURES, help="feature in the material (none: featureless material)")
    add("-o", "--output", type=Path, default=folder, metavar="DIR", help=f"folder (default {folder})")
    add_seed_argument(parser)
    for kind, count in (("train", TRAINING_SWEEPS), ("test", TEST_SWEEPS)):
        add(f"--{kind}", type=int, default=count, metavar="N", help=f"{kind} sweeps (default {count})")
    text = "channels of the two phalanges (default: 8 each); also writes scene.yaml"
    add("--channels", type=int, nargs=2, default=(), metavar="N", help=text)
    add("--never-reach", action="store_true", help="end the test sweeps before the feature")


def run(args: argparse.Namespace) -> int:
    """Write the training sweeps with the arm's positions, and the test sweeps with the true ones."""
    options = {"seed": args.seed, "channels": tuple(args.channels)}
    train = simulate_scan(args.feature, kind="train", sweeps=args.train, **options)
    reach = not args.never_reach
    test = simulate_scan(args.feature, kind="test", sweeps=args.test, reach_feature=reach, **options)
    for name, scan, position in (("train", train, train.odometry), ("test", test, test.truth)):
        path = args.output / f"{name}.csv"
        write_csv(path, scan, position)
        print(f"{path}: {len(scan.contact)} sweeps, {len(scan)} samples")
    if args.channels:
        path = args.output / "scene.yaml"
        save_scene(_scene(args.feature, args.channels), path)
        print(f"{path}: the scene, with {args.channels[0]} and {args.channels[1]} channels")
    return 0


def _scene(feature: str, channels: Sequence[int]) -> Scene:
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
    with whole_file(path) as unfinished:
        np.savetxt(unfinished, table, formats, delimiter=",", header=header, comments="")
