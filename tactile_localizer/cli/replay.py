"""``tactile-localizer replay``: localize the palm in a recording, without ROS."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from tactile_localizer.cli.progress import progress_bars
from tactile_localizer.cli.recordings import (
    add_configuration_arguments,
    add_recording_arguments,
    add_scan_arguments,
    add_start_arguments,
    check_starts,
    configuration_from_arguments,
    localizer_from_arguments,
    odometry_from_arguments,
    scan_from_arguments,
)
from tactile_localizer.cli.seeds import add_seed_argument
from tactile_localizer.cli.tables import print_tables
from tactile_localizer.offline.json_file import write_json
from tactile_localizer.offline.metrics import INCH, with_contact
from tactile_localizer.offline.replay import Track, replay
from tactile_localizer.offline.reports.learned import learned_values
from tactile_localizer.offline.reports.replay import replay_document
from tactile_localizer.offline.table import Table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    add_scan_arguments(parser)
    add_configuration_arguments(parser)
    add_seed_argument(parser)
    add_recording_arguments(parser)
    add_start_arguments(parser)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the summary and every estimate")


def run(args: argparse.Namespace) -> int:
    """Replay, print the error along the travel, and with ``--json`` write every estimate."""
    check_starts(args)
    scan, scene = scan_from_arguments(args)
    configuration = configuration_from_arguments(args)
    _, recording, odometry = odometry_from_arguments(args, scene)
    with progress_bars() as progress:
        localizer, calibration = localizer_from_arguments(args, scan, scene, progress)
        tracks = replay(localizer, with_contact(recording, scene, localizer.model.map), progress)
    learned = learned_values(scene, localizer.model, calibration)
    document = replay_document(
        scene, configuration, recording, tracks, learned, odometry=odometry, seed=args.seed
    )
    if configuration.uses_kernel_widths:
        # An import of half a second that the default model does not need.
        from tactile_localizer.core.calibration.kernel_widths import describe_unfit_widths

        if unfit := describe_unfit_widths(scan, scene):
            print(unfit)
    _print(document)
    for line in _unconverged(tracks):
        print(line)
    if args.json is not None:
        write_json(args.json, document, rows="updates")
        print(f"{args.json}: {len(document['updates'])} updates")
    return 0


def _unconverged(tracks: Sequence[Track]) -> Iterator[str]:
    """One line with the reason for each sweep that did not converge."""
    for track in tracks:
        if not len(track):
            yield f"sweep {track.number} did not converge: no usable sample"
        elif not track.converged.any():
            reason = track.reason[-1].partition(": ")[2] or track.reason[-1]
            yield f"sweep {track.number} did not converge: {track.state[-1].value} at its end; {reason}"


def _print(document: dict[str, Any]) -> None:
    console = Console(highlight=False, soft_wrap=True, markup=False, emoji=False)
    summary, timing, configuration = document["summary"], document["timing"], document["configuration"]
    for note in document["recording"]["notes"]:
        console.print(f"note: {note}")
    console.print(
        f"{summary['sweeps']} sweeps, {summary['strains']} samples, "
        f"{summary['measurement_updates']} measurement updates"
        + (f", {summary['refused']} refused" if summary["refused"] else "")
        + f"; {configuration.model}, {configuration.filter} filter; odometry {summary['odometry']}"
    )
    console.print("learned: " + ", ".join(f"{name} {value}" for name, value in document["learned"].items()))
    if summary["contacts"]:
        console.print(f"travel counts from contact, which {summary['contacts']} sweeps reach")
    if summary["error_m"]["count"]:
        print_tables([_table(summary)])
        if "error_rad" in summary and summary["error_rad"]["count"]:
            median, mean, largest = (
                np.degrees(summary["error_rad"][name]) for name in ("median", "mean", "max")
            )
            console.print(f"yaw error {median:.2f}° (median), {mean:.2f}° (mean), {largest:.2f}° (largest)")
        console.print(
            f"95 % region covers {summary['coverage_95']:.1%}, "
            f"NEES {summary['nees']:.2f} per degree of freedom"
        )
    else:
        console.print("errors are unknown: the recording has no ground truth")
    arrived = summary["travel_to_convergence_m"]
    after = ""
    if arrived["count"]:
        distance = f"{arrived['median'] * 1e3:.1f} mm"
        after = f", {distance} after contact" if summary["contacts"] else f", after {distance} of travel"
        after += " (median)"
    converged = f"{summary['converged_sweeps']} of {summary['sweeps']} sweeps"
    console.print(f"{converged} converged{after}")
    if timing["update_median_us"] is not None:
        console.print(
            f"measurement update {timing['update_median_us']:.0f} µs (median), "
            f"{timing['update_p99_us']:.0f} µs (99th percentile); "
            f"{timing['strain_mean_us']:.0f} µs per sample"
        )


def _table(summary: dict[str, Any]) -> Table:
    rows = []
    for mark, error in summary["error_after_travel_m"].items():
        place = f"after {float(mark) * 1e3:g} mm" if float(mark) else "at contact"
        rows.append((place, str(error["count"]), *_lengths(error)))
    names = {"error_m": "all samples", "error_contact_m": "in contact", "error_converged_m": "converged"}
    rows += [(title, "", *_lengths(summary[name])) for name, title in names.items() if summary[name]["count"]]
    return Table("", ("error", "sweeps", "median mm", "inch", "mean mm", "inch", "largest mm", "inch"), rows)


def _lengths(error: dict[str, Any]) -> list[str]:
    values = [error[name] for name in ("median", "mean", "max")]
    return [text for value in values for text in (f"{value * 1e3:.2f}", f"{value / INCH:.3f}")]
