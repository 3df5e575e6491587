"""``tactile-localizer evaluate``: many sweeps, all models and filters; the paper's figures and findings."""

from __future__ import annotations

import argparse
import os
import shlex
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table as Shown

from tactile_localizer.cli.progress import progress_bars
from tactile_localizer.cli.recordings import (
    add_recording_arguments,
    add_start_arguments,
    check_starts,
    read_recordings,
    scan_from_arguments,
)
from tactile_localizer.errors import ParameterError, ScanError
from tactile_localizer.evaluation.conditions import (
    SIMULATED_FEATURES,
    Condition,
    RecordedCondition,
    SimulatedCondition,
)
from tactile_localizer.evaluation.evaluate import Results, evaluate
from tactile_localizer.evaluation.evaluation_report import evaluation_report
from tactile_localizer.evaluation.fabric import FABRICS, fabric_condition
from tactile_localizer.evaluation.figures import evaluation_figures
from tactile_localizer.evaluation.jobs import Workers
from tactile_localizer.evaluation.methods import Method, standard_methods, tuning_methods
from tactile_localizer.evaluation.plain_json import write_json
from tactile_localizer.evaluation.report import save_figures
from tactile_localizer.evaluation.tables import Table, evaluation_tables
from tactile_localizer.io.configuration_file import load_configuration

NAME = "evaluate"
HELP = "measure accuracy, convergence and calibration of all models and filters"
DATA = "TACTILE_LOCALIZER_DATA"
"""Names the directory of recorded data in the environment."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    add_condition_arguments(parser, sweeps=18, seeds=5, blanks=True)
    parser.add_argument(
        "--methods",
        nargs="+",
        metavar="NAME",
        help=f"YAML files, or of: {', '.join(standard_methods())} (default: all of these); "
        f"or of: {', '.join(tuning_methods())}",
    )
    add_worker_arguments(parser)
    parser.add_argument("-o", "--output", type=Path, default=Path("out/evaluate"), metavar="DIR")


def add_condition_arguments(parser: argparse.ArgumentParser, sweeps: int, seeds: int, blanks: bool) -> None:
    """Declare what to try on: simulated features, or own recordings on an own scan."""
    parser.add_argument(
        "--features",
        nargs="+",
        choices=(*SIMULATED_FEATURES, *FABRICS),
        default=SIMULATED_FEATURES,
        help=f"default: {', '.join(SIMULATED_FEATURES)}; fabrics need --data; none of it with recordings",
    )
    parser.add_argument(
        "--data",
        type=Path,
        default=os.environ.get(DATA),
        metavar="DIR",
        help=f"holds fabric_slide/*.csv (default: {DATA} of the environment)",
    )
    parser.add_argument(
        "--sweeps", type=int, default=sweeps, metavar="N", help=f"simulated test sweeps (default {sweeps})"
    )
    if blanks:
        parser.add_argument(
            "--blanks", type=int, default=18, metavar="N", help="sweeps that reach nothing (default 18)"
        )
    parser.add_argument(
        "--seeds", type=int, default=seeds, metavar="N", help=f"repetitions (default {seeds})"
    )
    parser.add_argument("--scan", metavar="SCAN", help="scan file, to evaluate on own recordings")
    parser.add_argument("--scene", help="scene file (default: the scan's)")
    add_recording_arguments(parser, "*")
    add_start_arguments(parser)


def add_worker_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare who does the work."""
    parser.add_argument(
        "--jobs", type=int, default=1, metavar="N", help="processes (default 1; -1: all cores)"
    )
    parser.add_argument("--dask", metavar="ADDRESS", help="do the work on this dask cluster")


def run(args: argparse.Namespace) -> int:
    """Evaluate, print the tables, write figures, report and numbers."""
    methods = methods_of(args.methods)
    conditions = conditions_from_arguments(args)
    workers = Workers(args.jobs, args.dask)
    with progress_bars() as progress:
        results = evaluate(conditions, methods, args.output / "tasks", workers, progress)
    tables, figures = evaluation_tables(results), evaluation_figures(results)
    print_tables(tables)
    save_figures(figures, args.output)
    command = shlex.join(["tactile-localizer", *args.command_line])
    evaluation_report(results, tables, figures, command, args.output / "report.html")
    write_json(args.output / "evaluate.json", _document(results, tables))
    print(f"{args.output}/report.html, evaluate.json, {', '.join(f'{name}.png' for name in figures)}")
    return 0


def methods_of(names: Sequence[str] | None) -> list[Method]:
    """Methods of a list of names: standard ones, those that compare parameters, or YAML files.

    Raises
    ------
    ParameterError
        Another name, or a file that is no configuration.
    """
    standard = standard_methods()
    if names is None:
        return list(standard.values())
    known = standard | tuning_methods()
    for name in names:
        if name not in known and not Path(name).exists():
            raise ParameterError(f"--methods {name}: expected a YAML file or one of {', '.join(known)}")
    return [known.get(name) or Method(Path(name).stem, load_configuration(name)) for name in names]


def conditions_from_arguments(args: argparse.Namespace) -> list[Condition]:
    """What ``add_condition_arguments`` has declared.

    Raises
    ------
    ParameterError, ScanError
        A count out of its range, or recordings without a scan or the other way round.
    """
    for name in ("sweeps", "seeds"):
        if getattr(args, name) < 1:
            raise ParameterError(f"--{name}: expected at least 1, got {getattr(args, name)}")
    blanks = getattr(args, "blanks", 0)
    if blanks < 0:
        raise ParameterError(f"--blanks: expected at least 0, got {blanks}")
    seeds = range(1, args.seeds + 1)
    if args.scan is None:
        if args.recordings:
            raise ParameterError("recordings: expected --scan with them")
        return [
            _fabric(name, seed, args.data)
            if name in FABRICS
            else SimulatedCondition(name, seed, args.sweeps, blanks)
            for name in args.features
            for seed in seeds
        ]
    if not args.recordings:
        raise ScanError(f"{args.scan}: expected recordings to localise on it")
    scan, scene = scan_from_arguments(args)
    recording, _ = read_recordings(args, scene)
    check_starts(args)
    return [
        RecordedCondition(scene.name, seed, scan, scene, recording, args.starts, args.travel)
        for seed in seeds
    ]


def _fabric(name: str, seed: int, folder: Path | None) -> Condition:
    if folder is None:
        raise ParameterError(f"--features {name}: expected --data or {DATA} to say where the recordings are")
    return fabric_condition(name, seed, Path(folder) / "fabric_slide")


def print_tables(tables: Sequence[Table]) -> None:
    """Print tables: numbers as wide as they are, words within the terminal."""
    terminal = Console(highlight=False, soft_wrap=True)
    for table in tables:
        words = [any(len(row[column]) > _WORDS for row in table.rows) for column in range(len(table.columns))]
        shown = Shown(title=table.title, title_justify="left", box=SIMPLE)
        for number, name in enumerate(table.columns):
            shown.add_column(name, justify="left" if words[number] or number == 0 else "right")
        for row in table.rows:
            shown.add_row(*row)
        console = terminal if any(words) else Console(highlight=False, soft_wrap=True, width=_WIDEST)
        console.print(shown)
        if table.note:
            terminal.print(f" {table.note}\n")


_WORDS = 60
_WIDEST = 250


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
