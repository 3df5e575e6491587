"""Figure and tables of the trade-off."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from evaluation.methods import TENTH_INCH_MM
from evaluation.tradeoff import (
    BUDGETS_US,
    Trade,
    pareto_front,
    per_millimetre,
    per_update,
    within_budget,
)
from tactile_localizer.core.configuration import MODELS
from tactile_localizer.offline.axes import MM
from tactile_localizer.offline.table import Table

_COLOURS = dict(zip(MODELS, ("tab:blue", "tab:purple", "tab:red", "tab:orange", "tab:green"), strict=True))
_MARKERS = {"grid": "s", "particle": "o"}
_FEW_TICKS, _MANY_TICKS = (1.0, 2.0, 5.0), (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)
"""Ticks per decade of a time axis; many if it spans less than a decade."""
_COLUMNS = (
    "configuration",
    "error, mm",
    "95 % interval, mm",
    "coverage, %",
    "update, µs",
    "99 %, µs",
    "µs/mm",
    "memory, MB",
)


def tradeoff_tables(trades: Sequence[Trade]) -> list[Table]:
    """Tables of budgets, Pareto front, presets and all candidates."""
    front = pareto_front(trades)
    presets = [one for one in trades if one.candidate.preset]
    by_time = sorted(trades, key=lambda one: one.update_us)
    note = (
        "Error from contact to the feature's end with its 95 % confidence interval; processor time of one "
        "thread, minimum of three repetitions; peak memory without the scan."
    )
    return [
        _budgets(trades),
        Table(
            "Pareto front",
            _COLUMNS,
            [_row(one) for one in front],
            "No other candidate is both faster and more accurate.",
        ),
        Table("Presets", _COLUMNS, [_row(one) for one in presets], note),
        Table("All candidates", _COLUMNS, [_row(one) for one in by_time], note),
    ]


def _budgets(trades: Sequence[Trade]) -> Table:
    """Most accurate candidates within a time per update and per millimetre of travel."""
    best = min(one.error.mean for one in trades)

    def cells(found: Trade | None) -> tuple[str, str, str]:
        if found is None:
            return "none", "", ""
        return (
            found.candidate.name,
            f"{found.error.mean * MM:.2f}",
            f"{(found.error.mean - best) * MM:+.2f}",
        )

    rows = [
        (
            f"{budget:g}",
            *cells(within_budget(trades, budget)),
            *cells(within_budget(trades, budget, per_millimetre)),
        )
        for budget in BUDGETS_US
    ]
    return Table(
        "Budgets",
        ("budget, µs", "per update", "error, mm", "loss, mm", "per millimetre", "error, mm", "loss, mm"),
        rows,
        "The most accurate candidate within a processor time per measurement update (median), and per "
        "millimetre of travel; loss: relative to the most accurate of all.",
    )


def tradeoff_figure(trades: Sequence[Trade]) -> Figure:
    """Figure of the error over the time per update and per millimetre, with Pareto fronts and presets."""
    figure = Figure(figsize=(9.0, 5.0), layout="constrained")
    by_update, by_travel = figure.subplots(1, 2, sharey=True)
    _draw(by_update, trades, per_update)
    _draw(by_travel, trades, per_millimetre)
    by_update.set_yscale("log")
    by_update.set_ylim(bottom=0.82 * min(one.error.mean for one in trades) * MM)
    low, high = by_update.get_ylim()
    fine = tuple(number / 5 for number in range(5, 50))
    by_update.yaxis.set_major_locator(LogLocator(subs=fine if high < 2.5 * low else _MANY_TICKS))
    by_update.yaxis.set_major_formatter("{x:g}")
    by_update.yaxis.set_minor_formatter("")
    by_update.set_xlabel("processor time of an update, median, µs")
    by_travel.set_xlabel("processor time per millimetre of travel, µs")
    by_update.set_ylabel("mean error, mm (dashed: 0.1 inch)")
    handles, labels = by_update.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=7)
    return figure


def _draw(plot: Axes, trades: Sequence[Trade], duration: Callable[[Trade], float]) -> None:
    """Draw the error over one kind of time."""

    def places(some: Sequence[Trade]) -> tuple[list[float], list[float]]:
        return [duration(one) for one in some], [one.error.mean * MM for one in some]

    for model, colour in _COLOURS.items():
        for filter_, marker in _MARKERS.items():
            chosen = (model, filter_)
            own = [
                one
                for one in trades
                if (one.candidate.configuration.model, one.candidate.configuration.filter) == chosen
            ]
            if own:
                plot.scatter(*places(own), s=16, c=colour, marker=marker, label=f"{model}, {filter_}")
    plot.step(*places(pareto_front(trades, duration)), where="post", color="0.3", lw=1, label="Pareto front")
    plot.axhline(TENTH_INCH_MM, color="0.6", ls="--", lw=0.8)
    _draw_presets(plot, sorted((one for one in trades if one.candidate.preset), key=duration), duration)
    plot.set_xscale("log")
    low, high = plot.get_xlim()
    plot.xaxis.set_major_locator(LogLocator(subs=_MANY_TICKS if high < 8.0 * low else _FEW_TICKS))
    plot.xaxis.set_major_formatter("{x:g}")
    plot.xaxis.set_minor_formatter("")
    plot.tick_params(labelsize=8)
    plot.set_axisbelow(True)
    plot.grid(color="0.92")


def _draw_presets(plot: Axes, presets: Sequence[Trade], duration: Callable[[Trade], float]) -> None:
    """Circle the presets and write their names in a row at the bottom, sorted by time."""
    for number, one in enumerate(presets):
        place = (duration(one), one.error.mean * MM)
        plot.plot(*place, "o", ms=10, mfc="none", mec="black")
        plot.annotate(
            one.candidate.preset,
            place,
            xytext=((number + 0.5) / len(presets), 0.04),
            textcoords="axes fraction",
            fontsize=8,
            ha="center",
            arrowprops={"arrowstyle": "-", "color": "0.5", "lw": 0.7, "shrinkB": 6},
        )


def describe(trade: Trade) -> str:
    """One-line description of a trade."""
    return (
        f"{trade.candidate.name}: error {trade.error.mean * MM:.2f} mm, update {trade.update_us:.0f} µs "
        f"(99 %: {trade.update_p99_us:.0f} µs), {trade.memory_mb:.0f} MB"
    )


def _row(trade: Trade) -> tuple[str, ...]:
    return (
        trade.candidate.name,
        f"{trade.error.mean * MM:.2f}",
        f"{trade.error.low * MM:.2f}-{trade.error.high * MM:.2f}",
        f"{100 * trade.coverage:.1f}",
        f"{trade.update_us:.0f}",
        f"{trade.update_p99_us:.0f}",
        f"{trade.us_per_mm:.0f}",
        f"{trade.memory_mb:.0f}",
    )
