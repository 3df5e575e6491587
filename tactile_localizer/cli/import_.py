"""``tactile-localizer import``: make a scan from CSV files, bags or CAN logs."""

import argparse
import os
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from tactile_localizer.cli.outputs import InputPath, output_path
from tactile_localizer.cli.progress import progress_line
from tactile_localizer.cli.recordings import (
    add_delay_argument,
    add_gap_argument,
    add_reader_arguments,
    naming_from_arguments,
    options_of,
)
from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.geometry.motion import levers
from tactile_localizer.errors import ScanError, SceneError, counted, printable
from tactile_localizer.io.csv.columns import SWEEP, MissingColumnError, naming_to_dict
from tactile_localizer.io.csv.proposal import propose_scene
from tactile_localizer.io.csv.sweep_columns import sweep_columns
from tactile_localizer.io.readers import importable
from tactile_localizer.io.recording import Recording, delay_of, join
from tactile_localizer.io.scans.folder import STRAIN_DELAY, ScanFolder
from tactile_localizer.io.scans.importer import import_recording
from tactile_localizer.io.scans.learned import Reading, learn_and_keep
from tactile_localizer.io.scene_file import load_scene, save_scene
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
    """Declare a subcommand for each kind of recordings."""
    kinds = parser.add_subparsers(dest="kind", required=True, metavar="KIND")
    for kind, reader in importable().items():
        what = reader.what.replace("%", "%%")  # a suffix of another package may have any letters
        subparser = kinds.add_parser(kind, help=f"one or more {what}")
        add = subparser.add_argument
        add("recordings", type=InputPath, nargs="+", metavar="FILE", help=what)
        add_reader_arguments(subparser, kind)
        add_gap_argument(subparser)
        add_delay_argument(subparser, "estimated from strokes in opposite directions, if there are any")
        text = "detect sweeps in the motion; one_way: without the return strokes (default: as recorded)"
        add("--detect-sweeps", choices=("both_ways", "one_way"), help=text)
        is_proposed = kind == "csv"
        text = "scene file (YAML), or the name of a shipped one"
        text += " (default: a proposed one, written beside the scan)" * is_proposed
        add("--scene", type=InputPath, required=not is_proposed, help=text)
        text = "folder of the scan to create"
        add("-o", "--output", type=output_path, required=True, metavar="SCAN", help=text)
        add("--force", action="store_true", help="import even if less than half of the samples are usable")


def run(args: argparse.Namespace) -> int:
    """Import, and print the numbers of sweeps and pairs, skipped samples and findings."""
    scene = load_scene(given_or_shipped(args.scene, "config/scenes")) if args.scene else None
    assumptions: list[str] = []
    try:
        if scene is None:
            scene, assumptions = _proposed(args)
        options = options_of(args, scene, [args.kind] * len(args.recordings))
        recording, delay_s, text = _read_undelayed(args, scene, options)
    except MissingColumnError as error:
        for line in error.template.splitlines():
            print(printable(line))
        raise ScanError(f"{error}; or fill in the naming above and pass it by --columns FILE") from None
    detail = _detail(args, options[0])
    if delay_s:
        detail[STRAIN_DELAY] = round(delay_s, 4)
    try:
        scene.cells(_CELL_M / levers(scene))
    except SceneError as error:
        raise SceneError("; ".join((*recording.notes, str(error)))) from None
    what = f"import {args.kind}"
    notes = import_recording(recording, scene, args.output, what=what, detail=detail, force=args.force)
    if assumptions:
        path = Path(f"{args.output}{_PROPOSED}")
        save_scene(scene, path)
        print(f"{path}: a proposed scene; correct it and import again with --scene {path} if this is wrong:")
        for line in assumptions:
            print(f"  {printable(line)}")
    del recording  # a large one takes as much memory as all that follows
    made = Reading.of(ScanFolder(args.output))
    sweeps = made.recording.sweeps
    print(f"{args.output}: {counted(len(sweeps), 'sweep')}, {counted(len(made.scan), 'pair')}")
    notes = (*notes, *filter(None, (text,)), *findings(made.scan, scene, sweeps))
    # What asks whether a unit is another one is said last, where it is read, as all else depends on it.
    doubts = [note for note in notes if "? --column" in note]
    others = [note for note in notes if note not in doubts]
    for note in (*others, *_more_sweeps(args, scene, options[0]) * (len(sweeps) == 1)):
        print(f"  {printable(note)}", flush=True)
    with progress_line() as progress:
        examination = learn_and_keep(made, scene, Configuration(), progress)[0].examination
    results = (*describe_examination(scene, examination), *examination_findings(scene, examination))
    for line in (*results, *doubts):
        print(f"  {printable(line)}")
    return 0


def _detail(args: argparse.Namespace, options: Mapping[str, Any]) -> dict[str, Any]:
    """What the history of the scan has about an import with options of the reader."""
    given = {"files": args.recordings, **vars(args)}
    detail = {name: given[name] for name in ("files", "detect_sweeps", "dbc", "poses") if given.get(name)}
    if naming := options.get("naming"):
        detail["columns"] = naming_to_dict(naming)
    if adapter := options.get("adapter"):  # how its messages name their values
        detail["names"] = adapter.names
    return detail


def _more_sweeps(args: argparse.Namespace, scene: Scene, options: Mapping[str, Any]) -> list[str]:
    """A line about how to get more than one sweep of a recording with options of its reader."""
    ways = list[str]()
    if args.kind == "csv" and SWEEP not in (naming := options["naming"]).columns:
        found = sweep_columns(Path(args.recordings[0]), scene, naming)
        ways += [f"--column sweep={name} (whole numbers, constant over stretches)" for name in found]
    ways += ["--detect-sweeps both_ways"] * (args.detect_sweeps is None)
    return [f"for more sweeps: {', or '.join(ways)}"] * bool(ways)


def _read_undelayed(
    args: argparse.Namespace, scene: Scene, options: Sequence[Mapping[str, Any]]
) -> tuple[Recording, float, str]:
    """The recordings as one, the delay of the strain that it has no more, s, and what is said about it.

    Without ``--delay`` it is estimated from the recordings, which are read again if there is one.
    """
    read = partial(_read, args, scene, options)
    if args.delay is not None:
        text = f"strain is taken as {args.delay:g} s late (--delay)" if args.delay else ""
        return read(args.detect_sweeps, args.delay), args.delay, text
    # Without the return strokes there is nothing to compare.
    strokes = None if args.detect_sweeps == "one_way" else args.detect_sweeps
    recording = read(strokes)
    delay_s, text = _delay(args, scene, recording)
    if delay_s or strokes != args.detect_sweeps:
        del recording  # before it is in memory twice
        recording = read(args.detect_sweeps, delay_s)
    return recording, delay_s, text


def _delay(args: argparse.Namespace, scene: Scene, recording: Recording) -> tuple[float, str]:
    """A significant delay of the strain, s, and what is said about it."""
    if (delay := delay_of(recording, scene.axes)) is None:
        return 0.0, HIDDEN if args.kind == "bag" or vars(args).get("poses") else ""
    if not delay.is_significant:
        return 0.0, f"{delay}: not corrected" if delay.is_likely else ""
    advice = f"--delay 0 does not; the nodes need strain_delay_s: {delay.seconds:.3f}"
    return delay.seconds, f"{delay}: corrected ({advice})"


def _read(
    args: argparse.Namespace,
    scene: Scene,
    options: Sequence[Mapping[str, Any]],
    strokes: str | None,
    delay_s: float = 0.0,
) -> Recording:
    """The recordings as one; messages that an adapter reads have the same names in all of them.

    ``strokes`` is which sweeps to detect in the motion, as ``--detect-sweeps``.
    """
    detector = SweepDetector(scene.axes, one_way=strokes == "one_way") if strokes else None
    reader = importable()[args.kind]
    more: dict[str, Any] = {"detector": detector, "delay_s": delay_s, "max_gap_s": args.max_gap}
    with progress_line() as progress:
        more |= {"progress": progress} if args.kind in ("bag", "can") else {}
        more |= {"adapter": adapter} if (adapter := options[0].get("adapter")) else {}
        each = zip(args.recordings, options, strict=True)
        return join([reader.read(path, scene, **{**own, **more}) for path, own in each])


def _proposed(args: argparse.Namespace) -> tuple[Scene, list[str]]:
    """A proposed scene, and what was assumed."""
    path = Path(f"{args.output}{_PROPOSED}")
    if os.path.lexists(path):
        raise SceneError(
            f"{path}: expected no file; pass it by --scene {path}, or remove it for a new proposal"
        )
    naming = naming_from_arguments(args, {})
    return propose_scene(args.output.name, args.recordings, naming, args.poses, args.max_gap)
