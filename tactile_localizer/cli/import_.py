"""``tactile-localizer import``: make a scan from CSV files, bags or CAN logs."""

import argparse
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tactile_localizer.cli.outputs import InputPath, output_path
from tactile_localizer.cli.progress import progress_line
from tactile_localizer.cli.recordings import (
    add_bag_arguments,
    add_csv_arguments,
    add_delay_argument,
    add_gap_argument,
    bag_options,
    naming_from_arguments,
)
from tactile_localizer.cli.scan import examined
from tactile_localizer.core.geometry.motion import levers
from tactile_localizer.errors import CanError, ScanError, SceneError, counted, printable
from tactile_localizer.io.csv.columns import ColumnNaming, MissingColumnError, naming_to_dict
from tactile_localizer.io.csv.proposal import propose_scene
from tactile_localizer.io.csv.recording import read_csv
from tactile_localizer.io.csv.table import Table
from tactile_localizer.io.recording import Recording, delay_of, join, scan_of, undelayed
from tactile_localizer.io.scans.folder import STRAIN_DELAY, ScanFolder
from tactile_localizer.io.scans.importer import import_recording
from tactile_localizer.io.scene_file import load_scene, save_scene
from tactile_localizer.io.yaml_file import load_yaml, mapping
from tactile_localizer.offline.examination import describe_examination, examination_findings
from tactile_localizer.offline.scan_quality import findings
from tactile_localizer.resources import given_or_shipped
from tactile_localizer.scene import Scene
from tactile_localizer.streams.delay import HIDDEN
from tactile_localizer.streams.sweep_detector import SweepDetector

_CELL_M = 0.002
"""Size of the smallest cells of a map, m; rougher scans have larger ones."""

_PROPOSED = ".scene.yaml"
"""Ending of the file of a proposed scene, beside the scan."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare ``import csv``, ``import bag`` and ``import can``."""
    kinds = parser.add_subparsers(dest="kind", required=True, metavar="KIND")
    from_csv = kinds.add_parser("csv", help="one or more CSV files")
    text = "one sweep per file, unless a column has the sweep numbers"
    from_csv.add_argument("files", type=InputPath, nargs="+", metavar="FILE", help=text)
    add_csv_arguments(from_csv)
    from_bag = kinds.add_parser("bag", help="one or more bags: SQLite or MCAP, directory or file")
    from_bag.add_argument(
        "files", type=InputPath, nargs="+", metavar="BAG", help="directory, *.mcap or *.db3"
    )
    add_bag_arguments(from_bag)
    from_can = kinds.add_parser("can", help="one or more CAN logs: candump -l, .asc, .blf or .trc")
    text = "one sweep per log; the positions are those of --poses"
    from_can.add_argument("files", type=InputPath, nargs="+", metavar="LOG", help=text)
    _add_can_arguments(from_can)
    add_csv_arguments(from_can)
    proposal = " (default: a proposed one, written beside the scan)"
    for kind, proposed in ((from_csv, proposal), (from_bag, ""), (from_can, "")):
        add_gap_argument(kind)
        add_delay_argument(kind, "estimated from strokes in opposite directions, if there are any")
        text = "detect sweeps in the motion; one_way: without the return strokes (default: as recorded)"
        kind.add_argument("--detect-sweeps", choices=("both_ways", "one_way"), help=text)
        text = f"scene file (YAML), or the name of a shipped one{proposed}"
        kind.add_argument("--scene", type=InputPath, required=not proposed, help=text)
        kind.add_argument(
            "-o",
            "--output",
            type=output_path,
            required=True,
            metavar="SCAN",
            help="folder of the scan to create",
        )
        text = "import even if less than half of the samples are usable"
        kind.add_argument("--force", action="store_true", help=text)


def _add_can_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options for CAN logs: layout, channel."""
    add = parser.add_argument_group("CAN logs").add_argument
    add(
        "--dbc",
        type=InputPath,
        required=True,
        metavar="FILE",
        help="CAN database (DBC): a file, or the name of a shipped one",
    )
    text = "parameters of the driver node, if messages or signals do not have the default names"
    add("--params-file", type=InputPath, metavar="YAML", help=text)
    text = "channel in a log of several, as the file names or numbers it: can0, 1"
    add("--channel", default="", metavar="NAME", help=text)


def run(args: argparse.Namespace) -> int:
    """Import, and print the numbers of sweeps and pairs, skipped samples and findings."""
    scene = load_scene(given_or_shipped(args.scene, "config/scenes")) if args.scene else None
    assumptions: list[str] = []
    detail = {
        name: vars(args).get(name) for name in ("files", "detect_sweeps", "dbc") if vars(args).get(name)
    }
    if args.kind == "bag":
        assert scene is not None
        read = partial(_bags, args, scene, detail)
        recording = read(_detector(args, scene))
    else:
        naming = naming_from_arguments(args)
        detail |= {"columns": naming_to_dict(naming), "poses": args.poses}
        try:
            if scene is None:
                scene, assumptions = _proposed(args, naming)
            read = partial(_tables, args, scene, naming)
            recording = read(_detector(args, scene))
        except MissingColumnError as error:
            for line in error.template.splitlines():
                print(printable(line))
            raise
    # Without the return strokes there is nothing to compare.
    whole = read(None) if args.detect_sweeps == "one_way" and args.delay is None else recording
    delay_s, text = _delay(args, scene, whole)
    if delay_s:
        recording = undelayed(recording, scene.axes, delay_s, args.max_gap)
        detail[STRAIN_DELAY] = round(delay_s, 4)
    scene.cells(_CELL_M / levers(scene))
    what = f"import {args.kind}"
    notes = import_recording(recording, scene, args.output, what=what, detail=detail, force=args.force)
    if assumptions:
        path = Path(f"{args.output}{_PROPOSED}")
        save_scene(scene, path)
        print(f"{path}: a proposed scene; correct it and import again with --scene {path} if this is wrong:")
        for line in assumptions:
            print(f"  {printable(line)}")
    del recording  # a large one takes as much memory as all that follows
    made = ScanFolder(args.output).recording()
    print(f"{args.output}: {counted(len(made.sweeps), 'sweep')}, {counted(len(made), 'pair')}")
    scan = scan_of(made, scene)
    for note in (*notes, *filter(None, (text,)), *findings(scan, scene, made.sweeps)):
        print(f"  {printable(note)}", flush=True)
    del made
    examination = examined(args.output, scan, scene)
    for line in (*describe_examination(scene, examination), *examination_findings(scene, examination)):
        print(f"  {printable(line)}")
    return 0


def _delay(args: argparse.Namespace, scene: Scene, recording: Recording) -> tuple[float, str]:
    """The delay of the strain to correct, s, that given or a significant one, and what is said about it."""
    if args.delay is not None:
        return args.delay, f"strain is taken as {args.delay:g} s late (--delay)" if args.delay else ""
    if (delay := delay_of(recording, scene.axes)) is None:
        is_one_source = args.kind == "csv" and not args.poses
        return 0.0, "" if is_one_source else HIDDEN
    if not delay.is_significant:
        return 0.0, f"{delay}: not corrected" if delay.is_likely else ""
    advice = f"--delay 0 does not; the nodes need strain_delay_s: {delay.seconds:.3f}"
    return delay.seconds, f"{delay}: corrected ({advice})"


def _bags(
    args: argparse.Namespace, scene: Scene, detail: dict[str, Any], detector: SweepDetector | None
) -> Recording:
    """The recording of bags; notes in ``detail`` how an adapter's messages name their values."""
    # Imported here because rosbags takes 0.3 s, which CSV files do not need.
    from tactile_localizer.io.bags.recording import read_bag

    with progress_line() as progress:
        options = {**bag_options(args, scene), "detector": detector, "progress": progress}
        recording = join([read_bag(file, scene, **options) for file in args.files])
    if options["adapter"] is not None:
        detail["names"] = options["adapter"].names
    return recording


def _tables(
    args: argparse.Namespace, scene: Scene, naming: ColumnNaming, detector: SweepDetector | None
) -> Recording:
    """The recording of CSV files, or of CAN logs with CSV files of the poses."""
    if args.kind == "can" and not args.poses:
        raise ScanError("import can: expected --poses FILE with the palm positions beside the log")
    strain = _log_reader(args, scene) if args.kind == "can" else None
    return read_csv(
        args.files,
        scene,
        naming,
        poses=args.poses,
        max_gap_s=args.max_gap,
        strain=strain,
        detector=detector,
    )


def _detector(args: argparse.Namespace, scene: Scene) -> SweepDetector | None:
    if args.detect_sweeps is None:
        return None
    return SweepDetector(scene.axes, one_way=args.detect_sweeps == "one_way")


def _proposed(args: argparse.Namespace, naming: ColumnNaming) -> tuple[Scene, list[str]]:
    """A proposed scene, and what was assumed."""
    path = Path(f"{args.output}{_PROPOSED}")
    if os.path.lexists(path):
        raise SceneError(
            f"{path}: expected no file; pass it by --scene {path}, or remove it for a new proposal"
        )
    return propose_scene(args.output.name, args.files, naming, args.poses, args.max_gap)


def _log_reader(args: argparse.Namespace, scene: Scene) -> Callable[[Path], Table]:
    """A function that reads the strain of the scene's phalanges in a log.

    Raises
    ------
    CanError, SceneError
        The DBC lacks a phalanx of the scene, or has another number of channels for it.
    """
    # Imported here because cantools takes 0.3 s, which other recordings do not need.
    from tactile_localizer.io.can.log import read_log
    from tactile_localizer.io.can.protocol import protocol_of

    parameters = load_yaml(args.params_file, "a parameter file", CanError, _flat) if args.params_file else {}
    protocol = protocol_of(scene.phalanx_names, {**parameters, "dbc": args.dbc})
    scene.channels(protocol.phalanges, protocol.channels.counts)  # as many as the scene has

    def table(path: Path) -> Table:
        with progress_line() as progress:
            stamp_ns, strain, lost, notes = read_log(path, protocol, args.channel, progress)
        return Table(stamp_ns, np.empty((len(strain), 0)), strain, {}, lost, notes)

    return table


def _flat(content: Any, prefix: str = "") -> dict[str, Any]:
    """Parameters in a file of ROS by their names, with dots between group and member."""
    found: dict[str, Any] = {}
    for name, value in mapping(content, "parameters").items():
        if isinstance(value, dict):
            found |= _flat(value, "" if "ros__parameters" in (name, *value) else f"{prefix}{name}.")
        else:
            found[f"{prefix}{name}"] = value
    return found
