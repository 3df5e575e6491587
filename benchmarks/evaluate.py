"""Compare the accuracy, convergence and calibration of methods on simulated features or recordings.

    scripts/in_env python benchmarks/evaluate.py [--jobs N] [--methods NAME ...] [RECORDING ... --scan SCAN]

By default: bump, snap and grommet (18 test sweeps and 18 that end before the feature, 5 seeds with a training
scan each) with the default, the presets, sums of Gaussians with widths chosen from the scan, and the paper's
four models in the paper's form and with the exact filter. It prints tables and writes report.html,
evaluate.json and figures into out/evaluate. Results of tasks are kept there; an interrupted run resumes.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from evaluation.comparison import Method, Results, evaluate
from evaluation.figures import evaluation_figures
from evaluation.jobs import Workers
from evaluation.methods import standard_methods
from evaluation.options import (
    add_condition_arguments,
    add_worker_arguments,
    conditions_from_arguments,
    exit_status,
)
from evaluation.report import save_figures, write_report
from evaluation.tables import configuration_table, evaluation_tables

from tactile_localizer.cli.progress import progress_bars
from tactile_localizer.cli.tables import print_tables
from tactile_localizer.errors import ParameterError
from tactile_localizer.io.configuration_file import load_configuration
from tactile_localizer.offline.json_file import write_json
from tactile_localizer.offline.table import Table


def main(argv: Sequence[str] | None = None) -> int:
    """Evaluate; returns the exit status: 2 for an unusable request, 130 for an interrupt."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add_condition_arguments(parser, sweeps=18, seeds=5)
    parser.add_argument(
        "--blanks", type=int, default=18, metavar="N", help="simulated sweeps that end before the feature"
    )
    parser.add_argument(
        "--methods",
        nargs="+",
        metavar="NAME",
        help=f"YAML files, or names of: {', '.join(standard_methods())} (default: all of these)",
    )
    add_worker_arguments(parser)
    parser.add_argument("-o", "--output", type=Path, default=Path("out/evaluate"), metavar="DIR")
    args = parser.parse_args(arguments)
    return exit_status(lambda: _run(args, shlex.join(["benchmarks/evaluate.py", *arguments])))


def _run(args: argparse.Namespace, command: str) -> int:
    """Evaluate, print the tables, write figures, report and numbers."""
    if args.blanks < 0:
        raise ParameterError(f"--blanks: expected at least 0, got {args.blanks}")
    methods, conditions = methods_of(args.methods), conditions_from_arguments(args, args.blanks)
    with progress_bars() as progress:
        results = evaluate(
            conditions, methods, args.output / "tasks", Workers(args.jobs, args.dask), progress
        )
    tables, figures = evaluation_tables(results), evaluation_figures(results)
    print_tables(tables)
    save_figures(figures, args.output)
    write_report(
        args.output / "report.html",
        "Tactile localization: evaluation",
        f"Tried on {', '.join(results.condition_names)}: {', '.join(results.methods)}.",
        figures,
        [*tables, configuration_table(results)],
        command,
    )
    write_json(args.output / "evaluate.json", _document(results, tables))
    print(f"{args.output}/report.html, evaluate.json, {', '.join(f'{name}.png' for name in figures)}")
    return 0


def methods_of(names: Sequence[str] | None) -> list[Method]:
    """Methods by names of standard ones or YAML files.

    Raises
    ------
    ParameterError
        An unknown name, or a file that is not a configuration.
    """
    known = standard_methods()
    if names is None:
        return list(known.values())
    for name in names:
        if name not in known and not Path(name).exists():
            raise ParameterError(f"--methods {name}: expected a YAML file or one of {', '.join(known)}")
    return [known.get(name) or Method(Path(name).stem, load_configuration(name)) for name in names]


def _document(results: Results, tables: Sequence[Table]) -> dict[str, object]:
    return {
        "conditions": [condition.identity for condition in results.conditions],
        "methods": {name: asdict(method) for name, method in results.methods.items()},
        "tables": {
            table.title: [dict(zip(table.columns, row, strict=True)) for row in table.rows]
            for table in tables
        },
        "tasks": results.tasks,
    }


if __name__ == "__main__":
    raise SystemExit(main())
