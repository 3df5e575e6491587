"""``tactile-localizer replay``: localize the palm in a recording, without ROS."""

import argparse
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from tactile_localizer.cli.outputs import InputPath, output_path, results, write_picture, write_report
from tactile_localizer.cli.progress import progress_line
from tactile_localizer.cli.recordings import (
    add_recording_arguments,
    add_scan_arguments,
    add_seed_argument,
    odometry_from_arguments,
    scan_from_arguments,
)
from tactile_localizer.cli.tables import print_table
from tactile_localizer.core.configuration import FILTERS, SWEEP_MIXTURE
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.core.scan.range import ScanRange, describe_misfit
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import counted, printable
from tactile_localizer.io.configuration_file import PRESETS, load_configuration
from tactile_localizer.io.recording import Recording, usable
from tactile_localizer.io.scans.learned import learned_calibration
from tactile_localizer.offline.axes import MM
from tactile_localizer.offline.metrics import with_contact
from tactile_localizer.offline.replay import replay
from tactile_localizer.offline.replay_document import Evaluation, replay_document
from tactile_localizer.scene import Scene


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    add_scan_arguments(parser)
    text = f"preset ({', '.join(PRESETS)}) or YAML file; the other options override it"
    parser.add_argument("--config", type=InputPath, metavar="PRESET", help=text)
    text = f"{SWEEP_MIXTURE} (default), or module:Class, such as tactile_localizer.paper:SumOfGaussians"
    parser.add_argument("--model", metavar="MODEL", help=text)
    parser.add_argument("--filter", choices=FILTERS, help="Bayes filter (default: grid, which is exact)")
    add_seed_argument(parser)
    add_recording_arguments(parser)
    text = "write the summary and every estimate (-: to standard output, all else to standard error)"
    add = partial(parser.add_argument, type=output_path, metavar="FILE")
    add("--json", help=text)
    add("--plot", help="draw the error (*.png, *.pdf, *.svg)")
    add("--report", help="write a report to send (one HTML file)")


def run(args: argparse.Namespace) -> int:
    """Replay and print errors, convergence and the verdict; 0 if it is a success, else 1."""
    with results(args) as write:
        return _replay(args, write)


def _replay(args: argparse.Namespace, write: Callable[[dict[str, Any]], None]) -> int:
    scan, scene = scan_from_arguments(args)
    configuration = load_configuration(args.config, model=args.model, filter=args.filter)
    recording, odometry = odometry_from_arguments(args, scene, args.recordings)
    with progress_line() as progress:
        calibration = learned_calibration(args.scan, scan, scene, progress)
        rng = np.random.default_rng(args.seed)
        localizer = build_localizer(scan, scene, configuration, rng, progress, calibration)
        sweeps = replay(localizer, with_contact(recording, localizer.model), progress)
    evaluation = Evaluation(
        args.scan, scan, scene, configuration, calibration, localizer, recording, odometry, args.seed, sweeps
    )
    verdict, document = evaluation.verdict, replay_document(evaluation)
    write(document)
    if args.plot is not None:
        from tactile_localizer.offline.figures.replay import replay_figure

        write_picture(args.plot, replay_figure(sweeps))
    notes = [*map(printable, filter(None, (*recording.notes, _misfit(scan, scene, recording))))]
    if args.report is not None:
        from tactile_localizer.offline.reports.replay import replay_report

        write_report(args.report, partial(replay_report, evaluation, document, notes))
    for line in notes:
        print(f"note: {line}")
    _print(document, args.scan)
    print(*verdict.notes, verdict, sep="\n")
    return 0 if verdict.success else 1


def _misfit(scan: Scan, scene: Scene, recording: Recording) -> str:
    """A warning if strains or positions are outside the range of the scan; empty otherwise."""
    if not len(recording):
        return ""
    bounds = ScanRange.of(scan, scene)
    strains, positions = [], []
    for sweep in recording.sweeps:
        strains.append(bounds.strains_outside(sweep.strain, usable(sweep.status)))
        if sweep.truth is None:
            positions.append(bounds.positions_outside(sweep.position, sweep.position[:1].sum(axis=0)))
        else:
            outside = (sweep.truth < scene.lower) | (sweep.truth > scene.upper)
            positions.append((outside & ~scene.wraps).any(axis=1))
    fractions = [float(np.concatenate(parts).mean()) for parts in (strains, positions)]
    return describe_misfit(*fractions)


def _print(document: dict[str, Any], scan: str) -> None:
    summary, timing, configuration = document["summary"], document["timing"], document["configuration"]
    print(
        f"{counted(summary['sweeps'], 'sweep')}, {counted(summary['strains'], 'sample')}, "
        f"{counted(summary['measurement_updates'], 'measurement update')}"
        + (f", {summary['refused']} refused" if summary["refused"] else "")
        + f"\n{configuration.model}, {configuration.filter} filter; odometry {summary['odometry']}"
    )
    print(f"learned from {scan}:")
    for name, value in document["learned"].items():
        print(f"  {name:20} {value}")
    place = "contact" if summary["contacts"] else "the start"
    if summary["contacts"]:
        print(f"travel counts from contact, reached in {counted(summary['contacts'], 'sweep')}")
    if summary["error_m"]["count"]:
        errors = {
            f"{float(mark) * MM:g} mm after {place}" if float(mark) else f"at {place}": error
            for mark, error in summary["error_after_travel_m"].items()
        }
        errors |= {"all samples": summary["error_m"], "in contact": summary["error_contact_m"]}
        errors["converged"] = summary["error_converged_m"]
        rows = [_row(name, error, MM) for name, error in errors.items() if error["count"]]
        if "error_rad" in summary:
            rows.append(_row("yaw, degrees", summary["error_rad"], np.degrees(1.0)))
        print()
        print_table(("error, mm", "number", "median", "mean", "largest"), rows)
        print(f"\n95 % region covers {summary['coverage_95']:.1%}")
    else:
        print("errors are unknown: the recording has no ground truth")
    arrived = summary["travel_to_convergence_m"]
    if arrived["count"]:
        print(f"converged {arrived['median'] * MM:.1f} mm after {place} (median)")
    if timing["update_median_us"] is not None:
        print(
            f"measurement update {timing['update_median_us']:.0f} µs (median), "
            f"{timing['update_p99_us']:.0f} µs (99 %); "
            f"{timing['strain_mean_us']:.0f} µs per sample"
        )


def _row(name: str, error: dict[str, Any], scale: float) -> tuple[str, ...]:
    return name, str(error["count"]), *(f"{error[key] * scale:.2f}" for key in ("median", "mean", "max"))
