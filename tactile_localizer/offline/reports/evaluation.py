"""HTML report of an evaluation."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from matplotlib.figure import Figure

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.offline.evaluation.comparison import Results
from tactile_localizer.offline.reports.html import Report, mapping_table
from tactile_localizer.offline.reports.machine import machine
from tactile_localizer.offline.table import Table

_HEADINGS = {
    "methods": ("All methods", "Mean error with its 95 % confidence interval over sweeps."),
    "convergence": (
        "Convergence along the travel",
        "Fraction of the sweeps that have converged, over the travel since contact.",
    ),
}


def evaluation_report(
    results: Results, tables: list[Table], figures: dict[str, Figure], command: str, path: Path
) -> None:
    """Write an evaluation as one page.

    Parameters
    ----------
    tables, figures : from :func:`~.tables.evaluation_tables` and
        :func:`~tactile_localizer.offline.figures.comparison.evaluation_figures`
    command : the command line

    Raises
    ------
    ScanError
        The file cannot be written.
    """
    n = len(results.sweeps(next(iter(results.methods))))
    seeds = len({condition.seed for condition in results.conditions})
    report = Report(
        "Tactile localization: evaluation",
        f"{n} sweeps on {', '.join(results.condition_names)}, {_count(seeds, 'seed')}, "
        f"{_count(len(results.methods), 'method')}.",
    )
    by_title = {table.title: table for table in tables}
    report.add_table(by_title.pop("Error"))
    for name, figure in figures.items():
        heading, note = _HEADINGS[name]
        report.add_figures(heading, {name: figure}, note)
    for table in by_title.values():
        report.add_table(table)
    report.add_table(configuration_table(results))
    report.add_table(mapping_table("Made with", {"command": command, **machine()}))
    report.write(path)


def configuration_table(results: Results) -> Table:
    """Table of the fields in which each method's configuration differs from the default."""
    default = asdict(Configuration())
    rows = []
    for name, method in results.methods.items():
        own = {**asdict(method.configuration), **method.measurement}
        changed = {key: value for key, value in own.items() if default.get(key) != value}
        rows.append((name, ", ".join(f"{k}: {_short(v)}" for k, v in changed.items()) or "the defaults"))
    defaults = ", ".join(f"{k}: {_short(v)}" for k, v in default.items())
    return Table("Configurations", ("method", "differs from the default in"), rows, f"Default: {defaults}.")


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def _short(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
