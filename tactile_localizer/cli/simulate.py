"""``tactile-localizer simulate``: recordings of the simulated hand."""

import argparse
from functools import partial
from pathlib import Path

import numpy as np

from tactile_localizer.cli.outputs import output_path, require_writable
from tactile_localizer.cli.recordings import add_seed_argument
from tactile_localizer.errors import counted
from tactile_localizer.io.csv.columns import channel_names
from tactile_localizer.io.recording import Recording
from tactile_localizer.io.scene_file import save_scene
from tactile_localizer.io.whole_file import whole_file
from tactile_localizer.scene import Scene
from tactile_localizer.sim import FEATURES, shipped_scene, simulate_recording
from tactile_localizer.sim.scan import TEST_SWEEPS, TRAINING_SWEEPS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the feature, the seed and the numbers of sweeps."""
    add, folder = parser.add_argument, Path("out/simulate")
    add("feature", choices=FEATURES, help="feature in the material (none: featureless material)")
    add("-o", "--output", type=output_path, default=folder, metavar="DIR", help=f"folder (default {folder})")
    add_seed_argument(parser)
    text = f"training sweeps, 2.54 mm apart (default {TRAINING_SWEEPS}: the whole square; more scan it again)"
    add("--train", type=int, default=TRAINING_SWEEPS, metavar="N", help=text)
    add("--test", type=int, default=TEST_SWEEPS, metavar="N", help=f"test sweeps (default {TEST_SWEEPS})")
    text = "channels of the two phalanges (default: 8 each); also writes scene.yaml"
    add("--channels", type=int, nargs=2, default=(), metavar="N", help=text)


def run(args: argparse.Namespace) -> int:
    """Write the training sweeps with the arm's positions, and the test sweeps with the true ones."""
    channels = tuple(args.channels)
    for name in ("train.csv", "test.csv", *["scene.yaml"] * bool(channels)):
        require_writable(args.output / name, args)
    simulate = partial(simulate_recording, args.feature, args.seed, channels=channels)
    train = simulate("train", sweeps=args.train)
    test = simulate("test", sweeps=args.test)
    scene = shipped_scene(args.feature, channels)
    for name, recording, positions in (("train", train, "position"), ("test", test, "truth")):
        path = args.output / f"{name}.csv"
        write_csv(path, recording, scene, positions)
        print(f"{path}: {counted(len(recording.sweeps), 'sweep')}, {len(recording)} samples")
    if channels:
        path = args.output / "scene.yaml"
        save_scene(scene, path)
        print(f"{path}: the scene, with {channels[0]} and {channels[1]} channels")
    return 0


def write_csv(path: Path, recording: Recording, scene: Scene, positions: str) -> None:
    """Write sweeps in the standard columns.

    Parameters
    ----------
    path : CSV file
    recording : sweeps with known truth and contact
    scene : its axes and phalanges
    positions : those to write, ``position`` or ``truth``

    Raises
    ------
    ScanError
        The file cannot be written.
    """
    strain_names = [column for each in scene.phalanges for column in channel_names(each.name, each.channels)]
    header = ",".join(["stamp_s", "sweep", *scene.axis_names, *strain_names, "felt"])
    sweeps = recording.sweeps
    number = np.repeat([sweep.number for sweep in sweeps], [len(sweep) for sweep in sweeps])
    stamp_ns, *columns = (
        np.concatenate([getattr(sweep, name) for sweep in sweeps])
        for name in ("stamp_ns", positions, "strain", "felt")
    )
    table = np.column_stack([stamp_ns * 1e-9, number, *columns])
    formats = ["%.9f", "%d", *["%.7f"] * scene.dimension, *["%.6f"] * len(strain_names), "%d"]
    with whole_file(path) as unfinished:
        np.savetxt(unfinished, table, formats, delimiter=",", header=header, comments="")
