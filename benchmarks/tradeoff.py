"""Measure accuracy against computing time, and choose a configuration.

    scripts/in_env python benchmarks/tradeoff.py [--budget-us US] [--target-mm MM] [RECORDING ... --scan SCAN]

Candidates vary model, filter, particles, cells and travel between updates. They are tried on
simulated bump, snap and grommet (9 test sweeps each), or on recordings. It prints tables with the Pareto
front and writes report.html, tradeoff.json and tradeoff.png into out/tradeoff. With a budget or a target it
prints the configuration to use instead, with status 1 where none meets the request. Results of tasks are kept
there; an interrupted run resumes.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

import yaml
from evaluation.conditions import Condition
from evaluation.jobs import Workers
from evaluation.options import (
    add_condition_arguments,
    add_worker_arguments,
    conditions_from_arguments,
    exit_status,
)
from evaluation.report import save_figures, write_report
from evaluation.tradeoff import (
    Trade,
    candidates,
    for_target,
    trade,
    within_budget,
)
from evaluation.tradeoff_report import (
    describe,
    tradeoff_figure,
    tradeoff_tables,
)

from tactile_localizer.cli.progress import progress_bars
from tactile_localizer.cli.tables import print_tables
from tactile_localizer.errors import ParameterError
from tactile_localizer.offline.json_file import write_json


def main(argv: Sequence[str] | None = None) -> int:
    """Try all candidates; returns the exit status."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
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
    args = parser.parse_args(arguments)
    return exit_status(lambda: _run(args, shlex.join(["benchmarks/tradeoff.py", *arguments])))


def _run(args: argparse.Namespace, command: str) -> int:
    """Try all candidates and write figure, report and numbers; 1 where none meets the budget or target."""
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
    title = "Tactile localization: accuracy and computing time"
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


if __name__ == "__main__":
    raise SystemExit(main())
