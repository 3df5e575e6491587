"""The choice of parameters as tables and a picture: what was tried, and how well it localised."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import starmap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tactile_localizer.core.likelihood.neighbours import NeighbourTrial
from tactile_localizer.core.selection import Trial, best_of
from tactile_localizer.evaluation.tables import Table


def by_widths(trials: Sequence[Trial]) -> list[Trial]:
    """For each pair of kernel widths the trial with its best correlation length, narrow ones first."""
    widths = sorted({(trial.position_factor, trial.strain_factor) for trial in trials})
    return [
        best_of([trial for trial in trials if (trial.position_factor, trial.strain_factor) == pair])
        for pair in widths
    ]


def tuning_table(trials: Sequence[Trial], axes: Sequence[str]) -> Table:
    """What was tried, a row for each pair of kernel widths; the chosen one is marked."""
    best = best_of(trials)
    rows = [
        (
            "*" if trial is best else "",
            " ".join(starmap(_length, zip(axes, _position_std(trial), strict=True))),
            f"{np.median(trial.parameters.strain_std):.4g}",
            f"{_correlation_mm(trial):g}",
            f"{trial.score:.3f}",
            f"{trial.coverage:.1%}",
            f"{trial.merit:.3f}",
        )
        for trial in by_widths(trials)
    ]
    columns = ("", "S_x, one sigma", "S_z, median", "length, mm", "score, nats", "coverage", "merit")
    note = (
        "Score: log-density at the true position of held-out sweeps, over a uniform belief; merit: less a "
        "penalty where the 95 % region covers too little; *: chosen, with narrower kernels for a "
        "whole scan whose sweeps leave gaps."
    )
    return Table("Kernel widths", columns, rows, note)


def best_neighbours(trials: Sequence[NeighbourTrial]) -> NeighbourTrial:
    """The number of neighbours that is chosen."""
    return max(trials, key=lambda trial: trial.score)


def neighbours_table(trials: Sequence[NeighbourTrial]) -> Table:
    """The numbers of neighbours of the Gaussian models that were tried; the chosen one is marked."""
    best = best_neighbours(trials)
    rows = [
        (
            "*" if trial is best else "",
            str(trial.neighbours),
            f"{trial.shrinkage.share:.2f}",
            f"{trial.shrinkage.before:.3g}",
            f"{trial.shrinkage.after:.3g}",
            f"{trial.score:.2f}",
        )
        for trial in trials
    ]
    columns = ("", "k", "shrinkage", "unshrunk", "shrunk", "score, nats")
    note = (
        "Of the Gaussian models. Shrinkage: share of the covariance that is that of held-out residuals, "
        "itself chosen by their likelihood; unshrunk, shrunk: median squared Mahalanobis distance of "
        "held-out strains over that of a normal distribution; score: their log-likelihood; *: chosen."
    )
    return Table("Neighbours", columns, rows, note)


def tuning_figure(trials: Sequence[Trial], by_neighbours: Sequence[NeighbourTrial]) -> Figure:
    """Merit over the widths and, at the chosen ones, the correlation length; fit over the neighbours."""
    figure = Figure(figsize=(13.0, 3.8), layout="constrained")
    widths, lengths, neighbours = figure.subplots(1, 3)
    _draw_widths(widths, trials)
    _draw_lengths(lengths, trials)
    _draw_neighbours(neighbours, by_neighbours)
    return figure


def _draw_widths(plot: Axes, trials: Sequence[Trial]) -> None:
    best = best_of(trials)
    for factor in sorted({trial.position_factor for trial in trials}):
        own = [trial for trial in by_widths(trials) if trial.position_factor == factor]
        label = f"S_x at {factor:g} of the sweeps' spacing"
        plot.plot([t.strain_factor for t in own], [t.merit for t in own], "o-", ms=4, label=label)
    _mark_chosen(plot, best.strain_factor, best.merit)
    plot.set_xlabel("S_z, share of the sweeps' disagreement")
    plot.set_ylabel("merit, nats a strain")
    plot.legend(fontsize=7)
    _tick_tried(plot, {trial.strain_factor for trial in trials})


def _draw_lengths(plot: Axes, trials: Sequence[Trial]) -> None:
    best = best_of(trials)
    at_widths = [
        trial
        for trial in trials
        if (trial.position_factor, trial.strain_factor) == (best.position_factor, best.strain_factor)
    ]
    # Each length was tried with more than one tempering by the change of strain.
    every_mm = sorted({_correlation_mm(trial) for trial in at_widths})
    chosen = [best_of([trial for trial in at_widths if _correlation_mm(trial) == mm]) for mm in every_mm]
    plot.plot(every_mm, [trial.merit for trial in chosen], "o-", ms=4, color="black", label="merit")
    plot.plot(every_mm, [trial.score for trial in chosen], "o:", ms=3, color="0.5", label="score")
    _mark_chosen(plot, _correlation_mm(best), best.merit)
    plot.set_xlabel("correlation length, mm")
    plot.set_ylabel("nats a strain")
    coverage = plot.twinx()
    coverage.plot(every_mm, [trial.coverage for trial in chosen], "s--", ms=3, color="tab:blue")
    coverage.set_ylabel("coverage of the 95 % region", color="tab:blue")
    coverage.tick_params(colors="tab:blue")
    plot.legend(fontsize=7, loc="lower center")
    _tick_tried(plot, every_mm)


def _draw_neighbours(plot: Axes, trials: Sequence[NeighbourTrial]) -> None:
    numbers, best = [trial.neighbours for trial in trials], best_neighbours(trials)
    plot.plot(numbers, [trial.score for trial in trials], "o-", ms=4, color="black")
    _mark_chosen(plot, best.neighbours, best.score)
    plot.set_xlabel("neighbours k of the Gaussian models")
    plot.set_ylabel("log-likelihood of held-out sweeps, nats a strain")
    _tick_tried(plot, numbers)


def _mark_chosen(plot: Axes, x: float, y: float) -> None:
    plot.plot(x, y, "o", ms=12, mfc="none", mec="black")


def _tick_tried(plot: Axes, tried: Iterable[float]) -> None:
    """A logarithmic axis with a tick at each value that was tried."""
    values = sorted(set(tried))
    plot.set_xscale("log")
    plot.set_xticks(values, [f"{value:g}" for value in values], fontsize=8)
    plot.minorticks_off()
    plot.grid(color="0.92")


def _position_std(trial: Trial) -> np.ndarray:
    return np.atleast_1d(np.asarray(trial.parameters.position_std, dtype=np.float64))


def _correlation_mm(trial: Trial) -> float:
    return 1e3 * float(trial.parameters.correlation_length or np.nan)


def _length(axis: str, std: float) -> str:
    return f"{axis} {np.degrees(std):.3g} deg" if axis == "yaw" else f"{axis} {std * 1e3:.3g} mm"
