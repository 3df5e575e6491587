"""The report of an evaluation."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from matplotlib.figure import Figure

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.offline.evaluation.comparison import Results
from tactile_localizer.offline.reports.html import Report, mapping_table
from tactile_localizer.offline.reports.machine import machine
from tactile_localizer.offline.reports.table import Table

_HEADINGS = {
    "fig5": (
        "Error along the sweep",
        "As the paper's Fig. 5: its particle filter and widths, mean over all sweeps.",
    ),
    "fig8": ("Featureless regions apart", "As the paper's Fig. 8: error above, covariance trace below."),
    "methods": ("All methods", "Mean error with its 95 % interval over sweeps."),
    "convergence": (
        "Convergence along the travel",
        "Share of sweeps that have converged, over the travel since contact.",
    ),
    "past": (
        "Past the feature",
        "Error over the travel since the feature's end; dotted: what the motion's noise alone makes of the "
        "error at its end.",
    ),
}


def evaluation_report(
    results: Results, tables: list[Table], figures: dict[str, Figure], command: str, path: Path
) -> None:
    """Write an evaluation as one page.

    Parameters
    ----------
    tables, figures : as :func:`.tables.evaluation_tables` and :func:`.figures.evaluation_figures` make them
    command : that made it

    Raises
    ------
    ScanError
        The file cannot be written.
    """
    n = len(results.sweeps(next(iter(results.methods))))
    seeds = len({condition.seed for condition in results.conditions})
    report = Report(
        "Tactile localisation: evaluation",
        f"{n} sweeps on {', '.join(results.condition_names)}, {_count(seeds, 'seed')}, "
        f"{_count(len(results.methods), 'method')}.",
    )
    by_title = {table.title: table for table in tables}
    report.add_table(by_title.pop("Error"))
    for start, (heading, note) in _HEADINGS.items():
        own = {name: figure for name, figure in figures.items() if name.startswith(start)}
        if own:
            report.add_figures(heading, own, note)
    for table in by_title.values():
        report.add_table(table)
    report.add_table(configuration_table(results))
    report.add_table(mapping_table("Made with", {"command": command, **machine()}))
    report.write(path)


def configuration_table(results: Results) -> Table:
    """What each method's configuration changes of the default."""
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
