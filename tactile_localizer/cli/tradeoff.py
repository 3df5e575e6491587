"""``tactile-localizer tradeoff``: accuracy against computing time, and a configuration to use."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Sequence
from pathlib import Path

import yaml

from tactile_localizer.cli.conditions import (
    add_condition_arguments,
    add_worker_arguments,
    conditions_from_arguments,
)
from tactile_localizer.cli.interrupts import end_as_by_interrupt
from tactile_localizer.cli.progress import progress_bars
from tactile_localizer.cli.tables import print_tables
from tactile_localizer.errors import ParameterError
from tactile_localizer.offline.evaluation.conditions import Condition
from tactile_localizer.offline.evaluation.jobs import Workers
from tactile_localizer.offline.evaluation.tradeoff import (
    Trade,
    candidates,
    for_target,
    trade,
    within_budget,
)
from tactile_localizer.offline.json_file import write_json
from tactile_localizer.offline.reports.html import save_figures, write_report
from tactile_localizer.offline.reports.tradeoff import (
    describe,
    tradeoff_figure,
    tradeoff_tables,
)

RESUMES = True


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument(
        "--budget-us",
        type=float,
        metavar="US",
        help="print the most accurate configuration within this update time, µs",
    )
    parser.add_argument(
        "--target-mm",
        type=float,
        metavar="MM",
        help="print the fastest configuration within this mean error, mm",
    )
    add_condition_arguments(parser, sweeps=9, seeds=1)
    add_worker_arguments(parser)
    parser.add_argument("-o", "--output", type=Path, default=Path("out/tradeoff"), metavar="DIR")


def run(args: argparse.Namespace) -> int:
    """Try all candidates and write figure, report and numbers; 1 where none meets the budget or target."""
    end_as_by_interrupt()
    for name in ("budget_us", "target_mm"):
        value = getattr(args, name)
        if value is not None and not value > 0:
            raise ParameterError(f"--{name.replace('_', '-')}: expected a positive number, got {value}")
    conditions = conditions_from_arguments(args)
    with progress_bars() as progress:
        trades = trade(
            conditions, candidates(), args.output / "tasks", Workers(args.jobs, args.dask), progress
        )
    tables, figure = tradeoff_tables(trades), tradeoff_figure(trades)
    figures = {"tradeoff": figure}
    save_figures(figures, args.output)
    title, command = (
        "Tactile localization: accuracy and time",
        shlex.join(["tactile-localizer", *args.command_line]),
    )
    write_report(args.output / "report.html", title, _conditions(conditions), figures, tables, command)
    write_json(args.output / "tradeoff.json", {"trades": trades})
    if args.budget_us is None and args.target_mm is None:
        print_tables(tables)
        print(f"{args.output}/report.html, tradeoff.json, tradeoff.png")
        return 0
    return _answer(args, trades)


def _answer(args: argparse.Namespace, trades: Sequence[Trade]) -> int:
    met = True
    if args.budget_us is not None:
        found = within_budget(trades, args.budget_us)
        met &= _print_choice(
            f"most accurate within {args.budget_us:g} µs", found, min(trades, key=lambda t: t.update_us)
        )
    if args.target_mm is not None:
        found = for_target(trades, args.target_mm * 1e-3)
        best = min(trades, key=lambda t: t.error.mean)
        met &= _print_choice(f"fastest within {args.target_mm:g} mm", found, best)
    return 0 if met else 1


def _print_choice(request: str, found: Trade | None, nearest: Trade) -> bool:
    """Print the chosen configuration as YAML, with comments on its use."""
    if found is None:
        print(f"# {request}: none; nearest is {describe(nearest)}")
        return False
    candidate = found.candidate
    given = [f"-p {name}:={str(value).lower()}" for name, value in candidate.changes.items()]
    print(f"# {request}: {describe(found)}")
    print("# save this and give it as --config, or put it under ros__parameters in config/filter.yaml")
    if candidate.preset and given:
        print(f"# shipped: tactile-localizer replay --config {candidate.preset}")
    if given:
        print(f"# live: ros2 run tactile_localizer filter_node --ros-args {' '.join(given)}")
    print(yaml.safe_dump(candidate.changes, sort_keys=False).rstrip() if given else "# the defaults")
    return True


def _conditions(conditions: Sequence[Condition]) -> str:
    names = ", ".join(dict.fromkeys(condition.name for condition in conditions))
    return f"Tried on {names}, {len({condition.seed for condition in conditions})} seeds."
