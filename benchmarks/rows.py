"""Rows of accuracy benchmarks: computed in parallel, written as JSON, printed as a table."""

import argparse
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from tactile_localizer.cli.progress import progress_line
from tactile_localizer.cli.tables import print_table
from tactile_localizer.io.whole_file import write_text
from tactile_localizer.offline import parallel
from tactile_localizer.offline.parallel import Lost

Row = dict[str, Any]


def in_parallel(
    function: Callable[..., list[Row]],
    arguments: Sequence[tuple[Any, ...]],
    jobs: int,
    what: str,
    cluster: str | None = None,
) -> Iterator[list[Row]]:
    """Rows of each call as soon as it is finished, in ``jobs`` processes or on a Dask cluster.

    Its workers need the folder of the benchmarks on ``PYTHONPATH``, and the files under the same paths. What
    is lost is named at the end, with status 1.
    """
    lost = []
    with progress_line() as show:
        calls = [(function, each) for each in arguments]
        options: dict[str, Any] = {"jobs": jobs, "cluster": cluster, "progress": show, "what": what}
        for number, rows in parallel.in_parallel(_called, calls, **options):
            if isinstance(rows, Lost):
                lost.append(f"lost: {arguments[number]}, {rows}")
            else:
                yield rows
    if lost:
        raise SystemExit("\n".join(lost))


def _called(function: Callable[..., list[Row]], arguments: tuple[Any, ...], _progress: Any) -> list[Row]:
    return function(*arguments)


def accuracy_parser(description: str) -> argparse.ArgumentParser:
    """Parser of the options of every accuracy benchmark."""
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--configuration", default="default", help="default, a preset, or a YAML file")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    parser.add_argument("--cluster", metavar="ADDRESS", help="Dask scheduler, in place of processes")
    parser.add_argument("--json", type=Path, metavar="FILE")
    return parser


def measured(
    function: Callable[..., list[Row]],
    calls: Sequence[tuple[Any, ...]],
    given: argparse.Namespace,
    order: Callable[[Row], Any],
    totals: Callable[[Sequence[Row]], list[Row]],
) -> list[Row]:
    """The rows of all calls in their ``order``; those so far and their ``totals`` are in the JSON file."""
    rows: list[Row] = []
    for own in in_parallel(function, calls, given.jobs, "measuring", given.cluster):
        rows = sorted(rows + own, key=order)
        if given.json is not None:
            write_rows(given.json, vars(given), rows, totals(rows))
    return rows


def write_rows(path: Path, arguments: Mapping[str, Any], rows: Sequence[Row], totals: Sequence[Row]) -> None:
    """Write ``arguments``, ``rows`` and ``totals``."""
    document = {"arguments": dict(arguments), "rows": rows, "totals": totals}
    write_text(path, json.dumps(document, indent=2, default=str) + "\n")


def print_rows(
    names: Sequence[str],
    columns: Mapping[str, tuple[str, str]],
    rows: Sequence[Row],
    totals: Sequence[Row] = (),
) -> None:
    """Print rows, and totals below them.

    Parameters
    ----------
    names : keys that identify a row
    columns : heading and format of each value by key; columns without values are omitted
    rows, totals : values by key; ``None`` where unknown
    """
    shown = {key: column for key, column in columns.items() if any(key in row for row in rows)}

    def texts(row: Row) -> list[str]:
        measured = ["-" if row.get(key) is None else f"{row[key]:{form}}" for key, (_, form) in shown.items()]
        return [*(str(row.get(name, "")) for name in names), *measured]

    headings = (*names, *(heading for heading, _ in shown.values()))
    print_table(headings, [texts(row) for row in (*rows, *totals)])
