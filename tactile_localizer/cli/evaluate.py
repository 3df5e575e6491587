"""``tactile-localizer evaluate``: compare methods on simulated features or recordings."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from tactile_localizer.cli.conditions import (
    add_condition_arguments,
    add_worker_arguments,
    conditions_from_arguments,
)
from tactile_localizer.cli.interrupts import end_as_by_interrupt
from tactile_localizer.cli.progress import progress_bars
from tactile_localizer.cli.tables import print_tables
from tactile_localizer.errors import ParameterError
from tactile_localizer.io.configuration_file import load_configuration
from tactile_localizer.offline.evaluation.comparison import Results, evaluate
from tactile_localizer.offline.evaluation.jobs import Workers
from tactile_localizer.offline.evaluation.methods import Method, standard_methods
from tactile_localizer.offline.figures.comparison import evaluation_figures
from tactile_localizer.offline.json_file import write_json
from tactile_localizer.offline.reports.html import save_figures, write_report
from tactile_localizer.offline.reports.tables import configuration_table, evaluation_tables
from tactile_localizer.offline.table import Table

RESUMES = True


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    add_condition_arguments(parser, sweeps=18, seeds=5, blanks=True)
    parser.add_argument(
        "--methods",
        nargs="+",
        metavar="NAME",
        help=f"YAML files, or names of: {', '.join(standard_methods())} (default: all of these)",
    )
    add_worker_arguments(parser)
    parser.add_argument("-o", "--output", type=Path, default=Path("out/evaluate"), metavar="DIR")


def run(args: argparse.Namespace) -> int:
    """Evaluate, print the tables, write figures, report and numbers."""
    end_as_by_interrupt()
    methods = methods_of(args.methods)
    conditions = conditions_from_arguments(args)
    workers = Workers(args.jobs, args.dask)
    with progress_bars() as progress:
        results = evaluate(conditions, methods, args.output / "tasks", workers, progress)
    tables, figures = evaluation_tables(results), evaluation_figures(results)
    print_tables(tables)
    save_figures(figures, args.output)
    command = shlex.join(["tactile-localizer", *args.command_line])
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
