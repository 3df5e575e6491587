"""Command-line options for recordings and scans, and the seed."""

import argparse
import importlib
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tactile_localizer.cli.outputs import InputPath
from tactile_localizer.errors import CanError, ParameterError, ScanError, listed
from tactile_localizer.io.bags.sweeps import TOPICS
from tactile_localizer.io.csv.columns import (
    ColumnNaming,
    MissingColumnError,
    load_naming,
    naming_from_dict,
    naming_from_pairs,
)
from tactile_localizer.io.readers import reader_of
from tactile_localizer.io.recording import Recording, delay_of, gap_notes
from tactile_localizer.io.scans.folder import ScanFolder
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.io.strain_adapter import load_adapter
from tactile_localizer.io.yaml_file import load_yaml, mapping
from tactile_localizer.offline.odometry import EXACT, RECORDED, SIMULATED, with_odometry
from tactile_localizer.offline.recordings import Read
from tactile_localizer.offline.scan_quality import strain_findings
from tactile_localizer.quantity import number
from tactile_localizer.resources import given_or_shipped
from tactile_localizer.scene import Scene
from tactile_localizer.streams.delay import MOST_DELAY_S
from tactile_localizer.streams.palm_frame import PalmFrame
from tactile_localizer.streams.synchronization import DEFAULT_MAX_GAP_S


def add_scan_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare ``--scan`` and ``--scene``."""
    add = partial(parser.add_argument, type=InputPath)
    add("--scan", required=True, metavar="SCAN", help="scan (folder) of the map")
    add("--scene", help="scene file (YAML), or the name of a shipped one (default: the scan's)")


def scene_from_arguments(args: argparse.Namespace) -> Scene:
    """The scene; prints a note if it is not that of the scan."""
    scanned = ScanFolder(args.scan).scene
    scene = load_scene(given_or_shipped(args.scene, "config/scenes")) if args.scene else scanned
    if scene.name != scanned.name:
        note = f"note: {args.scan} was scanned with scene {scanned.name}, and is used with {scene.name}"
        print(note, file=sys.stderr)
    return scene


def _add_csv_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options for CSV files: column names, separate poses."""
    add = parser.add_argument_group("CSV files").add_argument
    text = "column naming, if columns do not have the standard names"
    add("--columns", type=InputPath, metavar="YAML", help=text)
    text = "name of a column: stamp_s=time_ms*0.001, index=gauge1..8 (repeatable)"
    add("--column", action="append", default=[], metavar="NAME=COLUMN", help=text)
    text = "file of palm positions with their own stamps, interpolated at those of the strain (repeatable)"
    add("--poses", type=InputPath, action="append", default=[], metavar="FILE", help=text)


def _add_bag_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options for bags: topics, frames, adapter."""
    add = parser.add_argument_group("bags").add_argument
    for name, (topic, text) in TOPICS.items():
        add(f"--{name}-topic", default=topic, metavar="TOPIC", help=f"{text} (default: {topic})")
    text = "adapter from other messages to strain (docs/sensors.md): a file, or the name of a shipped one"
    add("--adapter", type=InputPath, metavar="YAML", help=text)
    text = "folder of .msg files: a bag of Foxy or Humble has no definitions of messages"
    add("--definitions", type=InputPath, metavar="FOLDER", help=text)
    text = "frame of the palm, looked up in --reference-frame on /tf and /tf_static, in place of --pose-topic"
    add("--palm-frame", default="", metavar="FRAME", help=text)
    text = "frame of poses that need no transform"
    add("--material-frame", default="material", metavar="FRAME", help=text)
    text = "frame of poses to transform by --material-pose"
    add("--reference-frame", default="base_link", metavar="FRAME", help=text)
    text = "pose of the material in the reference frame, m and rad"
    names = ("X", "Y", "Z", "ROLL", "PITCH", "YAW")
    add("--material-pose", type=float, nargs=6, default=[0.0] * 6, metavar=names, help=text)


def _add_can_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options for CAN logs: layout, channel."""
    add = parser.add_argument_group("CAN logs").add_argument
    text = "CAN database (DBC), which `import can` needs: a file, or the name of a shipped one"
    add("--dbc", type=InputPath, metavar="FILE", help=text)
    text = "parameters of the driver node, if messages or signals do not have the default names"
    add("--params-file", type=InputPath, metavar="YAML", help=text)
    text = "channel in a log of several, as the file names or numbers it: can0, 1"
    add("--channel", default="", metavar="NAME", help=text)


def add_gap_argument(parser: argparse.ArgumentParser) -> None:
    """Declare ``--max-gap``."""
    text = f"longest gap between poses that is interpolated, s (default: {DEFAULT_MAX_GAP_S:g})"
    parser.add_argument("--max-gap", type=_seconds, default=DEFAULT_MAX_GAP_S, metavar="S", help=text)


def add_delay_argument(parser: argparse.ArgumentParser, default: str) -> None:
    """Declare ``--delay``, ``None`` where it is not given; ``default`` says what it is then."""
    text = f"time by which strain is late against the poses, s (default: {default})"
    parser.add_argument("--delay", type=_delay, metavar="S", help=text)


def options_of(args: argparse.Namespace, scene: Scene, kinds: Sequence[str]) -> list[dict[str, Any]]:
    """Options of the reader of each recording, from the command line and how ``--scan`` was imported.

    Raises
    ------
    ScanError
        There are as many files of poses as neither one nor all, or a CAN log has none.
    """
    options = [_OPTIONS[kind](args, scene) if kind in _OPTIONS else {} for kind in kinds]
    beside, poses = [each for each in options if "poses" in each], vars(args).get("poses", [])
    if beside and len(poses) not in (0, 1, len(beside)):
        count = len(beside)
        raise ScanError(f"poses: expected 1 or {count} files beside {count}, got {len(poses)}")
    for each, one in zip(beside, poses if len(poses) > 1 else (), strict=False):
        each["poses"] = [one]
    return options


def _bag_options(args: argparse.Namespace, scene: Scene) -> dict[str, Any]:
    topics = {name: getattr(args, f"{name}_topic") for name in TOPICS}
    frame = PalmFrame(scene.axes, args.material_frame, args.reference_frame, args.material_pose)
    adapter = load_adapter(given_or_shipped(args.adapter, "config/adapters")) if args.adapter else None
    if adapter is not None:
        adapter = adapter.expect(_imported(args, "bag", "names"))
    options = {"topics": topics, "frame": frame, "palm_frame": args.palm_frame}
    options |= {"adapter": adapter, "definitions": args.definitions}
    return {**options, "by_status": "scan" not in args}  # an import wants the sweeps that were scanned


def _csv_options(args: argparse.Namespace, scene: Scene, kind: str = "csv") -> dict[str, Any]:
    naming = naming_from_arguments(args, _imported(args, kind, "columns"))
    return {"naming": naming, "poses": args.poses}


def _can_options(args: argparse.Namespace, scene: Scene) -> dict[str, Any]:
    for name, what in (("dbc", "the layout of the frames"), ("poses", "the palm positions beside the log")):
        if not getattr(args, name):
            raise ScanError(f"CAN log: expected --{name} FILE with {what}")
    parameters = load_yaml(args.params_file, "a parameter file", CanError, _flat) if args.params_file else {}
    options = {"dbc": args.dbc, "parameters": parameters, "channel": args.channel}
    return {**options, **_csv_options(args, scene, "can")}


_OPTIONS = {"bag": _bag_options, "can": _can_options, "csv": _csv_options}
_DECLARED = {
    "bag": (_add_bag_arguments,),
    "can": (_add_can_arguments, _add_csv_arguments),
    "csv": (_add_csv_arguments,),
}
"""Options of the readers that have some, and what declares them, by kind."""


def add_reader_arguments(parser: argparse.ArgumentParser, *kinds: str) -> None:
    """Declare the options of the readers of some kinds."""
    for declare in dict.fromkeys(declare for kind in kinds for declare in _DECLARED.get(kind, ())):
        declare(parser)


def _flat(content: Any, prefix: str = "") -> dict[str, Any]:
    """Parameters in a file of ROS by their names, with dots between group and member."""
    found: dict[str, Any] = {}
    for name, value in mapping(content, "parameters").items():
        if isinstance(value, dict):
            found |= _flat(value, "" if "ros__parameters" in (name, *value) else f"{prefix}{name}.")
        else:
            found[f"{prefix}{name}"] = value
    return found


def naming_from_arguments(args: argparse.Namespace, imported: Mapping[str, Any]) -> ColumnNaming:
    """The column naming of ``--columns`` and ``--column``.

    Parameters
    ----------
    args : the command line
    imported : naming that the scan was imported with, in its YAML form; replaced by ``--columns``
    """
    base = naming_from_dict(imported)
    if args.columns:
        base = load_naming(given_or_shipped(args.columns, "config/import"))
    return naming_from_pairs(args.column, base)


def _imported(args: argparse.Namespace, kind: str, detail: str) -> Mapping[str, Any]:
    """A detail of the last import of a kind into the scan of ``--scan``; empty without one."""
    found = _last_import(args, kind).get(detail)
    return found if isinstance(found, Mapping) else {}


def _last_import(args: argparse.Namespace, kind: str) -> Mapping[str, Any]:
    """The entry of the last import of a kind in the history of ``--scan``; empty without one."""
    history = ScanFolder(args.scan).history() if "scan" in args else []
    return next((entry for entry in reversed(history) if entry["what"] == f"import {kind}"), {})


def _seconds(text: str) -> float:
    try:
        return number(float(text), "seconds", lower=0.0)
    except (ValueError, ParameterError) as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _delay(text: str) -> float:
    try:
        return number(float(text), "delay", lower=-MOST_DELAY_S, upper=MOST_DELAY_S)
    except (ValueError, ParameterError) as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def add_recording_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the recordings and the options to read them."""
    text = "CSV file, scan, bag, CAN log, or what a reader of another package reads"
    parser.add_argument("recordings", type=InputPath, nargs="+", metavar="RECORDING", help=text)
    parser.add_argument(
        "--odometry",
        choices=(SIMULATED, EXACT),
        default=SIMULATED,
        help="odometry made of true positions: with simulated motion noise (default), or exact",
    )
    add_reader_arguments(parser, "csv", "bag", "can")
    add_gap_argument(parser)
    add_delay_argument(parser, "that which the import of the scan corrected")


def add_parallel_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare ``--jobs`` and ``--cluster``."""
    add = parser.add_argument
    add("--jobs", type=int, default=1, metavar="N", help="processes; -1: one per core")
    text = "Dask scheduler, such as tcp://host:8786, whose workers read the recordings and replay them"
    add("--cluster", metavar="ADDRESS", help=text)


def require_parallel(args: argparse.Namespace) -> None:
    """Require the libraries of ``--jobs`` and ``--cluster``.

    Raises
    ------
    ModuleNotFoundError
        There is no such library.
    """
    if args.cluster is not None:
        importlib.import_module("distributed")
    elif args.jobs != 1:
        importlib.import_module("joblib")


def readers_from_arguments(args: argparse.Namespace, scene: Scene) -> list[Read]:
    """A function for each recording of ``add_recording_arguments``, which any process can call to read it.

    Raises
    ------
    ScanError
        There is no such recording or no reader of it, only some of them are bags, or as :func:`options_of`.
    """
    kinds = [reader_of(path).kind for path in args.recordings]
    if "bag" in kinds and len({*kinds}) > 1:
        other = next(path for path, kind in zip(args.recordings, kinds, strict=True) if kind != "bag")
        raise ScanError(f"{other}: expected only bags beside a bag")
    if args.cluster is not None:  # workers have other working directories
        for name, given in vars(args).items():
            setattr(args, name, [*map(_absolute, given)] if isinstance(given, list) else _absolute(given))
    reads: list[Read] = [
        partial(_read_odometry, args, scene, number, options)
        for number, options in enumerate(options_of(args, scene, kinds))
    ]
    for path, read in zip(args.recordings, reads, strict=True):
        if not os.path.lexists(path):
            read()  # raises, before anything is learned
    return reads


def _absolute(given: Any) -> Any:
    is_there = isinstance(given, InputPath) and os.path.lexists(given)
    return InputPath(str(Path(given).absolute())) if is_there else given


def _noted(recording: Recording, scene: Scene, taken: str) -> Recording:
    """A recording with notes about how its strain is taken, lacks a position, is implausible, or is late."""
    notes = [
        *recording.notes,
        *[f"{recording.source}: {taken}"] * bool(taken),
        *gap_notes(recording),
        *strain_findings(scene, recording.sweeps),
    ]
    if (delay := delay_of(recording, scene.axes)) and delay.is_significant:
        notes.append(f"{recording.source}: {delay}; --delay {delay.seconds:.3f} corrects it")
    return replace(recording, notes=tuple(notes))


def _read_odometry(
    args: argparse.Namespace, scene: Scene, number: int, options: Mapping[str, Any]
) -> tuple[Recording, str]:
    """A recording, whose positions are odometry, and the kind of the odometry.

    Raises
    ------
    ScanError
        It cannot be read.
    """
    reader = reader_of(args.recordings[number])
    read = partial(reader.read, args.recordings[number], scene, **options)
    if reader.kind == "scan":  # whose import has corrected the delay
        recording = read()
    else:
        delay_s = ScanFolder(args.scan).strain_delay_s if args.delay is None else args.delay
        why = "as in the scan; --delay 0 takes it as it is" if args.delay is None else "--delay"
        taken = f"strain is taken as {delay_s:.3f} s late ({why})" if delay_s else ""
        try:
            recording = _noted(read(delay_s=delay_s, max_gap_s=args.max_gap), scene, taken)
        except MissingColumnError as error:
            imported = _last_import(args, reader.kind).get("poses")
            if error.quantity not in scene.axis_names or options.get("poses") or not imported:
                raise
            with_poses = f"expected --poses FILE beside it, as {args.scan} was imported with"
            found = f"found no column for {error.quantity}"
            raise ScanError(f"{args.recordings[number]}: {with_poses} {listed(imported)}; {found}") from None
    with_truth = [sweep for sweep in recording.sweeps if sweep.truth is not None]
    if reader.kind == "bag" or (with_truth and len(with_truth) == len(recording.sweeps)):
        return recording, RECORDED
    if with_truth:
        raise ScanError(f"{recording.source}: expected true positions beside the arm's in all or in none")
    # The noise must not use the random stream of the localizer, which is that of the filter node.
    noise = np.random.default_rng([args.seed, 1, number] if number else [args.seed, 1])
    return with_odometry(recording, scene, noise, args.odometry), args.odometry


def add_seed_argument(parser: argparse.ArgumentParser) -> None:
    """Declare ``--seed``."""
    parser.add_argument("--seed", type=_seed, default=1, help="random seed (default 1)")


def _seed(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"expected a non-negative integer, got {text}")
    return int(text)
