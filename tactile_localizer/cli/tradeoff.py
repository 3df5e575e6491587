"""``tactile-localizer tradeoff``: measure accuracy against computing time, and choose a configuration."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import yaml

from tactile_localizer.cli.progress import progress_bars
from tactile_localizer.cli.recordings import (
    add_recording_arguments,
    add_scan_arguments,
    odometry_from_arguments,
    scan_from_arguments,
)
from tactile_localizer.cli.seeds import add_seed_argument
from tactile_localizer.cli.tables import print_table
from tactile_localizer.errors import ParameterError
from tactile_localizer.io.whole_file import whole_file
from tactile_localizer.offline.axes import MM
from tactile_localizer.offline.figures.tradeoff import tradeoff_figure
from tactile_localizer.offline.json_file import write_json
from tactile_localizer.offline.tradeoff import (
    Candidate,
    Trade,
    candidates,
    for_target,
    named_configuration,
    pareto_front,
    sweep_axis,
    trade,
    within_budget,
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    add_scan_arguments(parser)
    add_recording_arguments(parser)
    add_seed_argument(parser)
    parser.add_argument(
        "--configurations",
        nargs="+",
        metavar="NAME",
        help="compare only these: default, presets, or YAML files (default: a choice of all parameters)",
    )
    request = parser.add_mutually_exclusive_group()
    request.add_argument(
        "--budget-us",
        type=float,
        metavar="US",
        help="write the most accurate configuration within this update time, µs",
    )
    request.add_argument(
        "--target-mm",
        type=float,
        metavar="MM",
        help="write the fastest configuration within this mean error, mm",
    )
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="processes; -1: one per core")
    parser.add_argument("--cluster", metavar="ADDRESS", help="dask scheduler to use instead")
    parser.add_argument("-o", "--output", type=Path, default=Path("tradeoff"), metavar="DIR")


def run(args: argparse.Namespace) -> int:
    """Measure, print the table, write picture and numbers; 1 where no candidate meets the request."""
    for name in ("budget_us", "target_mm"):
        value = getattr(args, name)
        if value is not None and not value > 0:
            raise ParameterError(f"--{name.replace('_', '-')}: expected a positive number, got {value}")
    scan, scene = scan_from_arguments(args)
    recordings = [odometry_from_arguments(args, scene, [path])[0] for path in args.recordings]
    names = args.configurations
    measured = [Candidate(Path(name).stem, named_configuration(name)) for name in names or ()]
    with progress_bars() as progress:
        trades = trade(
            scan,
            scene,
            recordings,
            measured or candidates(),
            seed=args.seed,
            jobs=args.jobs,
            cluster=args.cluster,
            progress=progress,
        )
    _print(trades, args.recordings)
    args.output.mkdir(parents=True, exist_ok=True)
    truth = np.concatenate([sweep.truth for one in recordings for sweep in one.sweeps])
    tradeoff_figure(trades, scene, sweep_axis(scene, truth)).savefig(args.output / "tradeoff.png", dpi=120)
    write_json(args.output / "tradeoff.json", {"candidates": [_row(one, args.recordings) for one in trades]})
    print(f"{args.output}/tradeoff.png, tradeoff.json")
    if args.budget_us is not None:
        return _write_choice(
            f"most accurate within {args.budget_us:g} µs per update",
            within_budget(trades, args.budget_us),
            min(trades, key=lambda one: one.update_us),
            args.output,
        )
    if args.target_mm is not None:
        return _write_choice(
            f"fastest within {args.target_mm:g} mm",
            for_target(trades, args.target_mm / MM),
            min(trades, key=lambda one: one.error),
            args.output,
        )
    return 0


def _write_choice(request: str, found: Trade | None, nearest: Trade, folder: Path) -> int:
    """Write the chosen configuration as a file; returns the exit status."""
    if found is None:
        print(f"{request}: none; nearest is {_describe(nearest)}")
        return 1
    path = folder / "configuration.yaml"
    values = yaml.safe_dump(found.candidate.changes, sort_keys=False) if found.candidate.changes else ""
    with whole_file(path) as unfinished:
        unfinished.write_text(f"# {request}: {_describe(found)}\n{values}", encoding="utf-8")
    print(f"{request}: {_describe(found)}")
    print(f"{path}: give it to replay as --config, or its values to the filter node as parameters")
    return 0


def _describe(one: Trade) -> str:
    return (
        f"{one.candidate.name}, error {one.error * MM:.2f} mm, update {one.update_us:.0f} µs, "
        f"{one.us_per_mm:.0f} µs/mm"
    )


def _row(one: Trade, recordings: Sequence[str]) -> dict[str, object]:
    errors = [np.nanmean(outcome.error) for outcome in one.outcomes]
    return {
        "name": one.candidate.name,
        "configuration": one.candidate.changes,
        "error_m": one.error,
        "error_half_width_m": one.error_half_width,
        "error_of_recording_m": dict(zip(recordings, errors, strict=True)),
        "coverage": one.coverage,
        "converged": one.converged,
        "update_us": one.update_us,
        "update_p99_us": one.update_p99_us,
        "us_per_mm": one.us_per_mm,
    }


def _print(trades: Sequence[Trade], recordings: Sequence[str]) -> None:
    """Print a row per candidate, from fast to slow; those on the Pareto front are marked."""
    front = pareto_front(trades)
    several = len(recordings) > 1
    rows = [
        (
            f"{one.candidate.name}{' *' if one in front else ''}",
            f"{one.error * MM:.2f} ± {one.error_half_width * MM:.2f}",
            *(f"{np.nanmean(outcome.error) * MM:.2f}" for outcome in one.outcomes if several),
            f"{100 * one.coverage:.1f}",
            f"{100 * one.converged:.0f}",
            f"{one.update_us:.0f}",
            f"{one.update_p99_us:.0f}",
            f"{one.us_per_mm:.0f}",
        )
        for one in sorted(trades, key=lambda one: one.us_per_mm)
    ]
    columns = (
        "configuration",
        "error, mm",
        *(Path(path).name for path in recordings if several),
        "coverage, %",
        "converged, %",
        "update, µs",
        "99 %, µs",
        "µs/mm",
    )
    note = (
        "Mean error from contact to the feature's end with its 95 % confidence interval over the sweeps, "
        "coverage of the 95 % region there, sweeps that converged; processor time of one thread for a "
        "measurement update, median and 99th percentile, and per millimetre of travel. *: no other candidate "
        "is both more accurate and faster per millimetre."
    )
    print_table("Accuracy and computing time", columns, rows, note)
