"""``tactile-localizer tradeoff``: measure accuracy against computing time, and choose a configuration."""

import argparse
from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from textwrap import fill

import yaml

from tactile_localizer.cli.outputs import InputPath, output_path, require_writable, write_picture
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
from tactile_localizer.errors import ParameterError
from tactile_localizer.io.scans.learned import learned_calibration
from tactile_localizer.io.whole_file import RESULT, write_text
from tactile_localizer.offline.axes import MM
from tactile_localizer.offline.json_file import write_json
from tactile_localizer.offline.parallel import Lost
from tactile_localizer.offline.recordings import load_pairs
from tactile_localizer.offline.tradeoff import (
    Candidate,
    Trade,
    candidates,
    for_target,
    named_configuration,
    pareto_front,
    trade,
)

_WIDTH = 80
"""Length of a note's lines, characters."""
_NOTE = """\
Mean error from contact to the feature's end, and its difference to that of {reference} on the same sweeps \
with the 95 % confidence interval; coverage of the 95 % region there; sweeps right at their end, and ever \
converged to a wrong position, of {sweeps}; processor time of one thread for a measurement update (median) \
and per millimetre of travel. *: no other one is as good in error, µs/mm and wrong sweeps, and \
better in one."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    add_scan_arguments(parser)
    add_recording_arguments(parser)
    add_seed_argument(parser)
    parser.add_argument(
        "--configurations",
        type=InputPath,
        nargs="+",
        metavar="NAME",
        help="compare only these: default, presets, or YAML files (default: a choice of all parameters)",
    )
    parser.add_argument(
        "--target-mm",
        type=float,
        metavar="MM",
        help="write the fastest configuration per millimetre of travel within this mean error, mm",
    )
    add_parallel_arguments(parser)
    text = "folder for rows, picture and configuration (default tradeoff)"
    parser.add_argument(
        "-o", "--output", type=output_path, default=Path("tradeoff"), metavar="DIR", help=text
    )


def run(args: argparse.Namespace) -> int:
    """Measure, print the table, write numbers and picture; 1 where none meets the request or one is lost."""
    if args.target_mm is not None and not args.target_mm > 0:
        raise ParameterError(f"--target-mm: expected a positive number, got {args.target_mm:g}")
    names = ("tradeoff.png", "tradeoff.json", "configuration.yaml")
    picture, numbers, chosen = (args.output / name for name in names)
    require_parallel(args)
    for path in (picture, numbers, *[chosen] * (args.target_mm is not None)):
        require_writable(path, args)
    scene = scene_from_arguments(args)
    scan = load_pairs(args.scan)
    reads = readers_from_arguments(args, scene)
    named = [Candidate(Path(name).stem, named_configuration(name)) for name in args.configurations or ()]
    with progress_line() as progress:
        calibration = learned_calibration(args.scan, scan, scene, progress)
        is_here = args.jobs == 1 and args.cluster is None
        trades, failed = trade(
            (lambda: scan) if is_here else partial(load_pairs, args.scan),
            scene,
            reads,
            named or candidates(scene),
            calibration,
            seed=args.seed,
            jobs=args.jobs,
            cluster=args.cluster,
            progress=progress,
        )
    if not trades:
        raise ParameterError("; ".join(f"{name}: {reason}" for name, reason in failed.items()))
    _print(trades)
    for name, reason in failed.items():
        print(f"{name}: not measured, {reason}")
    rows = [_row(one, trades[0]) for one in trades]
    write_json(numbers, {"candidates": rows, "not_measured": failed})
    print(numbers)
    try:
        from tactile_localizer.offline.figures.tradeoff import tradeoff_figure
    except ImportError as error:
        print(f"{picture}: left out, because it needs matplotlib, {error}")
    else:
        write_picture(picture, tradeoff_figure(trades))
    status = 0 if args.target_mm is None else _choose(trades, args.target_mm, chosen)
    return 1 if any(isinstance(reason, Lost) for reason in failed.values()) else status


def _choose(trades: Sequence[Trade], target_mm: float, path: Path) -> int:
    """Write the configuration that meets the target as a file; returns the exit status."""
    request, found = f"fastest within {target_mm:g} mm", for_target(trades, target_mm / MM)
    if found is None:
        print(f"{request}: none; nearest is {_describe(min(trades, key=lambda one: one.error))}")
        return 1
    values = yaml.safe_dump(found.candidate.changes, sort_keys=False) if found.candidate.changes else ""
    write_text(path, f"# {request}: {_describe(found)}\n# {RESULT}, which replaces it\n{values}")
    print(f"{request}: {_describe(found)}")
    print(f"{path}: pass it to replay as --config, or its values to the filter node as parameters")
    return 0


def _describe(one: Trade) -> str:
    return f"{one.candidate.name}, error {one.error * MM:.2f} mm, {one.us_per_mm:.0f} µs/mm"


def _row(one: Trade, reference: Trade) -> dict[str, object]:
    """Entry of the JSON file; lengths in m, and a difference with half its confidence interval."""
    return asdict(one) | {
        "candidate": one.candidate.name,
        "configuration": one.candidate.changes,
        "error": one.error,
        "difference": one.difference(reference),
    }


def _print(trades: Sequence[Trade]) -> None:
    """Print a row per candidate, from fast to slow; those on the Pareto front are marked."""
    front, reference = pareto_front(trades), trades[0]
    rows = []
    for one in sorted(trades, key=lambda one: one.us_per_mm):
        difference, half_width = one.difference(reference)
        rows.append(
            (
                f"{one.candidate.name}{' *' if one in front else ''}",
                f"{one.error * MM:.2f}",
                "-" if one is reference else f"{difference * MM:+.2f} ± {half_width * MM:.2f}",
                f"{100 * one.coverage:.0f}",
                str(one.verdict.right),
                str(one.verdict.wrong),
                f"{one.update_us:.0f}",
                f"{one.us_per_mm:.0f}",
            )
        )
    columns = ("", "mm", "difference", "cover", "right", "wrong", "µs", "µs/mm")
    print_table(columns, rows)
    note = _NOTE.format(reference=reference.candidate.name, sweeps=reference.verdict.expected)
    print(f"\n{fill(note, _WIDTH)}")
