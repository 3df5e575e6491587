"""Identification of the scan that a recording belongs to, with the probabilities along each sweep."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from tactile_localizer.core.identification import FeatureIdentifier
from tactile_localizer.errors import MeasurementError, ScanError
from tactile_localizer.io.recording import Recording, usable
from tactile_localizer.offline.axes import MM, legend_below
from tactile_localizer.offline.metrics import MARKS
from tactile_localizer.offline.odometry import travelled
from tactile_localizer.offline.table import Table
from tactile_localizer.scene import Scene

Progress = Callable[[str, float], None]

_REPORT_EVERY = 200
_COLUMNS = 3
_MAX_PLOTS = 18


@dataclass(frozen=True)
class IdentifiedSweep:
    """Probabilities along one sweep.

    Parameters
    ----------
    number : number of the sweep
    names : names of the K candidates and of the alternative "none"
    travel : (n,) travel from the start of the sweep, m
    probabilities : (n, K + 1); rows sum to one
    """

    number: int
    names: tuple[str, ...]
    travel: np.ndarray
    probabilities: np.ndarray

    @property
    def identified(self) -> str:
        """The most probable candidate at the end."""
        return self.names[int(np.argmax(self.probabilities[-1]))]

    @property
    def settled_m(self) -> float:
        """Travel after which the most probable candidate does not change, m."""
        others = np.flatnonzero(np.argmax(self.probabilities, axis=1) != self.names.index(self.identified))
        return float(self.travel[others[-1] + 1]) if len(others) else 0.0


def identify(
    identifier: FeatureIdentifier, scene: Scene, recording: Recording, progress: Progress | None = None
) -> list[IdentifiedSweep]:
    """Feed each sweep of a recording to an identifier, from a uniform prior.

    Parameters
    ----------
    identifier : identifier, reset before each sweep
    scene : scene with the axes of the recording
    recording : recording whose positions are the odometry
    progress : called with a description of the work and the completed fraction

    Raises
    ------
    ScanError
        No sweep has a usable sample.
    """
    found, done, total = [], 0, max(len(recording), 1)
    for sweep in recording.sweeps:
        identifier.reset()
        rows, probabilities = [], []
        names: tuple[str, ...] = ()
        samples = zip(
            sweep.stamp_ns.tolist(), sweep.position, sweep.strain, usable(sweep.status), strict=True
        )
        for row, sample in enumerate(samples):
            if progress is not None and row % _REPORT_EVERY == 0:
                progress("identifying", (done + row) / total)
            try:
                identification = identifier.update(*sample)
            except MeasurementError:
                continue
            rows.append(row)
            names = tuple(identification.probabilities)
            probabilities.append(list(identification.probabilities.values()))
        done += len(sweep)
        if rows:
            travel = travelled(scene, sweep.position)[rows]
            found.append(IdentifiedSweep(sweep.number, names, travel, np.array(probabilities)))
    if not found:
        raise ScanError(f"{recording.source}: expected usable strain, found none")
    if progress is not None:
        progress("identifying", 1.0)
    return found


def identification_table(sweeps: Sequence[IdentifiedSweep]) -> Table:
    """Probabilities at the end of each sweep, identified scan, and the travel after which it is settled."""
    names = sweeps[0].names
    rows = [
        (
            f"{sweep.number}",
            f"{sweep.travel[-1] * MM:.1f}",
            *(f"{probability:.3f}" for probability in sweep.probabilities[-1]),
            sweep.identified,
            f"{sweep.settled_m * MM:.1f}",
        )
        for sweep in sweeps
    ]
    return Table(
        "Probability at the end of each sweep",
        ("sweep", "travel mm", *names, "identified", "settled after mm"),
        rows,
        verdict(sweeps),
    )


def travel_table(sweeps: Sequence[IdentifiedSweep]) -> Table:
    """Mean probability of each candidate along the travel, over the sweeps that are long enough."""
    rows = []
    for mark in MARKS:
        reached = [sweep for sweep in sweeps if sweep.travel[-1] >= mark]
        if reached:
            along = [sweep.probabilities[np.searchsorted(sweep.travel, mark)] for sweep in reached]
            means = np.mean(along, axis=0)
            rows.append((f"{mark * MM:g}", str(len(reached)), *(f"{mean:.3f}" for mean in means)))
    return Table("Mean probability along the travel", ("travel mm", "sweeps", *sweeps[0].names), rows)


def verdict(sweeps: Sequence[IdentifiedSweep]) -> str:
    """Number of sweeps by identified scan, most frequent first."""
    counts = Counter(sweep.identified for sweep in sweeps).most_common()
    return ", ".join(f"{name}: {count} of {len(sweeps)} sweeps" for name, count in counts)


def identification_figure(sweeps: Sequence[IdentifiedSweep], title: str) -> Figure:
    """Probabilities along the travel, one plot for each of the first :data:`_MAX_PLOTS` sweeps."""
    shown = sweeps[:_MAX_PLOTS]
    columns = min(_COLUMNS, len(shown))
    rows = -(-len(shown) // columns)
    figure = Figure(figsize=(4.2 * columns, 2.2 * rows + 1.0), layout="constrained")
    plots = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for plot in plots.flat[len(shown) :]:
        plot.set_axis_off()
    for plot, sweep in zip(plots.flat, shown, strict=False):
        for name, probability in zip(sweep.names, sweep.probabilities.T, strict=True):
            style = {"color": "0.6", "linestyle": "--"} if name == sweep.names[-1] else {}
            plot.plot(sweep.travel * MM, probability, label=name, linewidth=1.2, **style)
        plot.set_ylim(-0.03, 1.03)
        plot.set_title(f"sweep {sweep.number}", fontsize=9)
    for plot in plots[-1]:
        plot.set_xlabel("travel, mm")
    for plot in plots[:, 0]:
        plot.set_ylabel("probability")
    legend_below(figure, plots.flat[0])
    figure.suptitle(title)
    return figure
