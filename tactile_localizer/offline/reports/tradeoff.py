"""Figure and tables of a trade-off."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from tactile_localizer.core.configuration import MODELS
from tactile_localizer.offline.axes import MM, TENTH_INCH_MM
from tactile_localizer.offline.evaluation.tradeoff import BUDGETS_US, Trade, pareto_front, within_budget
from tactile_localizer.offline.table import Table

_COLOURS = dict(zip(MODELS, ("tab:blue", "tab:purple", "tab:red", "tab:orange", "tab:green"), strict=True))
_MARKERS = {"grid": "s", "particle": "o"}
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
    """Tables of budgets, the Pareto front, the presets, and everything tried."""
    front = pareto_front(trades)
    presets = [one for one in trades if one.candidate.preset]
    everything = sorted(trades, key=lambda one: one.update_us)
    note = (
        "Error from contact to the feature's end with its 95 % confidence interval; processor time of one "
        "thread, least of three repetitions; peak memory beside the scan."
    )
    return [
        _budgets(trades),
        Table(
            "Pareto front",
            _COLUMNS,
            [_row(one) for one in front],
            "Nothing tried is both faster and more accurate.",
        ),
        Table("Presets", _COLUMNS, [_row(one) for one in presets], note),
        Table("Everything tried", _COLUMNS, [_row(one) for one in everything], note),
    ]


def _budgets(trades: Sequence[Trade]) -> Table:
    """What is lost with a given time for an update, beside the most accurate configuration."""
    best = min(one.error.mean for one in trades)
    rows = []
    for budget in BUDGETS_US:
        found = within_budget(trades, budget)
        if found is None:
            rows.append((f"{budget:g}", "none", "", "", "", ""))
            continue
        rows.append(
            (
                f"{budget:g}",
                found.candidate.name,
                f"{found.error.mean * MM:.2f}",
                f"{(found.error.mean - best) * MM:+.2f}",
                f"{found.update_us:.0f}",
                f"{found.us_per_mm:.0f}",
            )
        )
    return Table(
        "Budgets",
        ("budget, µs", "most accurate configuration", "error, mm", "to the best, mm", "update, µs", "µs/mm"),
        rows,
        "Budget: processor time of one measurement update, median. Where it has to be less, updates can be "
        "rarer: time per millimetre of travel.",
    )


def tradeoff_figure(trades: Sequence[Trade]) -> Figure:
    """Figure of error against update time, with the Pareto front and the presets."""
    figure = Figure(figsize=(7.0, 4.6), layout="constrained")
    plot = figure.add_subplot()
    for model, colour in _COLOURS.items():
        for filter_, marker in _MARKERS.items():
            chosen = (model, filter_)
            own = [
                one
                for one in trades
                if (one.candidate.configuration.model, one.candidate.configuration.filter) == chosen
            ]
            if own:
                plot.scatter(*_places(own), s=18, c=colour, marker=marker, label=f"{model}, {filter_}")
    front = pareto_front(trades)
    plot.step(*_places(front), where="post", color="0.3", lw=1, label="Pareto front")
    _draw_presets(plot, [one for one in trades if one.candidate.preset])
    plot.axhline(TENTH_INCH_MM, color="0.6", ls="--", lw=0.8)
    plot.set_axisbelow(True)
    plot.margins(x=0.3)
    plot.set_xscale("log")
    plot.set_yscale("log")
    plot.set_ylim(bottom=0.85 * front[-1].error.mean * MM)
    for axis, steps in ((plot.xaxis, (1.0, 2.0, 5.0)), (plot.yaxis, (1.0, 2.0, 3.0, 5.0))):
        axis.set_major_locator(LogLocator(subs=steps))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter("")
    plot.set_xlabel("processor time of an update, median, µs")
    plot.set_ylabel("mean error, mm (dashed: 0.1 inch)")
    plot.grid(color="0.92", which="both")
    plot.legend(fontsize=7)
    return figure


def _places(trades: Sequence[Trade]) -> tuple[list[float], list[float]]:
    """Update times, us, and mean errors, mm."""
    return [one.update_us for one in trades], [one.error.mean * MM for one in trades]


def _draw_presets(plot: Axes, presets: Sequence[Trade]) -> None:
    """Circle the presets and put their names below, in two rows without overlaps."""
    in_order = sorted(presets, key=lambda one: one.update_us)
    for row, one in enumerate(in_order):
        place = (one.update_us, one.error.mean * MM)
        plot.plot(*place, "o", ms=11, mfc="none", mec="black")
        plot.annotate(
            one.candidate.preset,
            place,
            xytext=(30 * (row - (len(in_order) - 1) / 2), -34 - 16 * (row % 2)),
            textcoords="offset points",
            fontsize=9,
            ha="center",
            arrowprops={"arrowstyle": "-", "color": "0.5", "lw": 0.7, "shrinkB": 6},
        )


def describe(trade: Trade) -> str:
    """Description of a trade in one line."""
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
