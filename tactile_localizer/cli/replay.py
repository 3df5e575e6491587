"""``tactile-localizer replay``: localize the palm in a recording, without ROS."""

import argparse
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from tactile_localizer.cli.outputs import InputPath, output_path, results, write_picture, write_report
from tactile_localizer.cli.progress import progress_line
from tactile_localizer.cli.recordings import (
    add_parallel_arguments,
    add_recording_arguments,
    add_scan_arguments,
    add_seed_argument,
    readers_from_arguments,
    require_parallel,
    scene_from_arguments,
)
from tactile_localizer.cli.tables import print_table
from tactile_localizer.core.configuration import FILTERS, SWEEP_MIXTURE
from tactile_localizer.core.scan.range import describe_misfit, describe_quiet
from tactile_localizer.errors import ScanError, counted, printable
from tactile_localizer.io.configuration_file import PRESETS, load_configuration
from tactile_localizer.io.scans.learned import ready_localizer
from tactile_localizer.offline.axes import MM
from tactile_localizer.offline.metrics import contact_map
from tactile_localizer.offline.parallel import Lost, in_parallel
from tactile_localizer.offline.recordings import (
    Make,
    ReplayedRecording,
    build_from_folder,
    joined,
    load_pairs,
    replay_recording,
)
from tactile_localizer.offline.replay_document import Evaluation, replay_document


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    add_scan_arguments(parser)
    text = f"preset ({', '.join(PRESETS)}) or YAML file; the other options override it"
    parser.add_argument("--config", type=InputPath, metavar="PRESET", help=text)
    text = f"{SWEEP_MIXTURE} (default), module:Class (tactile_localizer.paper:Gaussian), or one installed"
    parser.add_argument("--model", metavar="MODEL", help=text)
    parser.add_argument("--filter", choices=FILTERS, help="Bayes filter (default: grid, which is exact)")
    add_seed_argument(parser)
    add_recording_arguments(parser)
    add_parallel_arguments(parser)
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
    require_parallel(args)
    scene = scene_from_arguments(args)
    configuration = load_configuration(args.config, model=args.model, filter=args.filter)
    reads = readers_from_arguments(args, scene)
    with progress_line() as progress:
        rng = np.random.default_rng(args.seed)
        localizer, calibration, bounds, _ = ready_localizer(args.scan, scene, configuration, rng, progress)
        # A particle filter's random numbers begin anew with each recording, in whichever process that is.
        make: Make = partial(build_from_folder, args.scan, scene, configuration, args.seed)
        if args.jobs == 1 and args.cluster is None and (len(reads) == 1 or configuration.filter == "grid"):
            make = lambda: localizer  # noqa: E731
        contact = contact_map(localizer.model)
        calls = [(read, make, contact, bounds) for read in reads]
        found = dict(
            in_parallel(replay_recording, calls, jobs=args.jobs, cluster=args.cluster, progress=progress)
        )
    parts = {number: part for number, part in sorted(found.items()) if not isinstance(part, Lost)}
    lost = [f"{args.recordings[number]}: {found[number]}" for number in sorted(found.keys() - parts)]
    if not parts:
        raise ScanError(f"expected recordings that could be replayed, lost {'; '.join(lost)}")
    replayed = joined(list(parts.values()))
    evaluation = Evaluation(
        args.scan,
        partial(load_pairs, args.scan),
        scene,
        configuration,
        calibration,
        localizer,
        replayed,
        args.seed,
        [reads[number] for number in parts],
    )
    verdict, document = evaluation.verdict, replay_document(evaluation)
    write(document)
    if args.plot is not None:
        from tactile_localizer.offline.figures.replay import replay_figure

        write_picture(args.plot, replay_figure(replayed.sweeps))
    quiet = describe_quiet(scene.phalanx_names, replayed.spread)
    notes = [*map(printable, filter(None, (*replayed.notes, _misfit(replayed), quiet)))]
    if args.report is not None:
        from tactile_localizer.offline.reports.replay import replay_report

        write_report(args.report, partial(replay_report, evaluation, document, notes))
    for line in notes:
        print(f"note: {line}")
    _print(document, args.scan)
    print(*verdict.notes, verdict, sep="\n")
    for line in lost:
        print(f"lost: {printable(line)}")
    return 0 if verdict.success and not lost else 1


def _misfit(replayed: ReplayedRecording) -> str:
    """A warning if strains or positions are outside the range of the scan; empty otherwise."""
    outside = replayed.strains_outside, replayed.positions_outside
    return describe_misfit(*(float(each.mean()) for each in outside)) if len(outside[0]) else ""


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
