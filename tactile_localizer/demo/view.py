"""Views of the demonstration: live on a terminal, or line by line."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from tactile_localizer.demo.live_sweep import LIMIT_M, LiveSweep
from tactile_localizer.demo.material_map import material_map
from tactile_localizer.demo.observations import Observations
from tactile_localizer.demo.run import View
from tactile_localizer.offline.metrics import INCH
from tactile_localizer.scene import Scene

_REFRESH_S = 0.12
_SHOWN_SWEEPS = 5


@contextmanager
def demo_view(console: Console, scene: Scene, title: str) -> Iterator[View]:
    """Create the view for a console.

    Parameters
    ----------
    console : console for the output; a live view if it is a terminal, otherwise lines
    scene : scene of the demonstration
    title : title of the view
    """
    if not console.is_terminal:
        console.print(title)
        yield PlainView(console)
        return
    with Live(console=console, auto_refresh=False) as live:
        yield LiveView(live, scene, title)


class PlainView:
    """View that prints one line per event."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._begun_s = time.monotonic()
        self._note = ""

    def phase(self, text: str) -> None:
        """See :class:`View`."""
        self._print(text)

    def progress(self, done: int, total: int) -> None:
        """See :class:`View`."""
        if done and done % 7 == 0:
            self._print(f"{done} of {total} sweeps")

    def show(self, observations: Observations, received: Mapping[str, int], note: str) -> None:
        """See :class:`View`."""
        if note and note != self._note:
            self._note = note
            self._print(note)

    def sweep(self, sweep: LiveSweep) -> None:
        """See :class:`View`."""
        self._print(sweep_line(sweep))

    def _print(self, text: str) -> None:
        elapsed_s = time.monotonic() - self._begun_s
        self._console.print(f"{elapsed_s:5.1f} s  {text}", highlight=False, soft_wrap=True)


class LiveView:
    """Live view: a map of the material, numbers beside it, and finished sweeps below."""

    def __init__(self, live: Live, scene: Scene, title: str) -> None:
        self._live, self._scene, self._title = live, scene, title
        self._phase, self._done, self._total, self._note = "", 0, 0, ""
        self._sweeps: list[LiveSweep] = []
        self._shown_s = -math.inf
        self._rates: deque[tuple[float, dict[str, int]]] = deque(maxlen=9)

    def phase(self, text: str) -> None:
        """See :class:`View`."""
        self._phase, self._done, self._total, self._note = text, 0, 0, ""
        self._shown_s = -math.inf

    def progress(self, done: int, total: int) -> None:
        """See :class:`View`."""
        self._done, self._total = done, total

    def sweep(self, sweep: LiveSweep) -> None:
        """See :class:`View`."""
        self._sweeps.append(sweep)

    def show(self, observations: Observations, received: Mapping[str, int], note: str) -> None:
        """See :class:`View`."""
        now_s = time.monotonic()
        if now_s - self._shown_s < _REFRESH_S:
            return
        self._shown_s = now_s
        self._note = note
        self._rates.append((now_s, dict(received)))
        self._live.update(self._picture(observations), refresh=True)

    def _picture(self, observations: Observations) -> RenderableType:
        head = Table.grid(expand=True, padding=(0, 2))
        head.add_row(Text(self._title, style="bold"), self._phase_text(), self._bar())
        body = Table.grid(padding=(0, 2))
        body.add_row(
            Panel(material_map(self._scene, observations), title="material", border_style="dim"),
            self._numbers(observations),
        )
        lines = [Text(sweep_line(sweep), style="dim") for sweep in self._sweeps[-_SHOWN_SWEEPS:]]
        return Group(head, body, *lines)

    def _phase_text(self) -> Text:
        count = f" {self._done} of {self._total} sweeps" if self._total else ""
        return Text(f"{self._phase}{count} {self._note}", style="cyan", overflow="ellipsis", no_wrap=True)

    def _bar(self) -> RenderableType:
        return ProgressBar(total=self._total or None, completed=self._done, width=24, pulse=not self._total)

    def _numbers(self, observations: Observations) -> RenderableType:
        table = Table.grid(padding=(0, 2))
        table.add_column(style="dim", min_width=9)
        table.add_column(min_width=44)
        for name, value in self._rows(observations):
            table.add_row(name, value)
        return table

    def _rows(self, observations: Observations) -> Iterator[tuple[str, RenderableType]]:
        truth = np.array(observations.truths[-1][1:]) if observations.truths else None
        if truth is not None:
            yield "truth", _place(truth)
        if observations.posteriors:
            posterior = observations.posteriors[-1]
            mean = np.array(posterior.mean)
            yield "estimate", _place(mean)
            if truth is not None:
                error = float(np.linalg.norm(mean - truth))
                style = "green" if error <= LIMIT_M else "yellow"
                yield "error", Text(f"{error * 1e3:6.2f} mm  {error / INCH:6.3f} inch", style=style)
            deviations = np.sqrt(np.reshape(posterior.covariance, (2, 2)).diagonal()) * 1e3
            trace = posterior.covariance_trace * 1e6
            yield "trace", f"{trace:8.2f} mm²  ({deviations[0]:.2f} and {deviations[1]:.2f} mm)"
            yield "probability", f"{posterior.probability:6.3f} that the palm is within the radius"
            style = "bold green" if posterior.converged else "yellow"
            yield "state", Text(posterior.reason, style=style)
        if observations.status is not None:
            yield (
                "scan",
                f"{observations.status.samples} pairs, {observations.status.coverage:.0%} of the material",
            )
        yield "rates", self._rate_text()
        values = observations.diagnostics.get("filter: belief", {})
        if "update_median_us" in values:
            yield "update", f"median {values['update_median_us']} µs, 99 % {values['update_p99_us']} µs"
        yield "dropped", f"{observations.frames_dropped} frames"

    def _rate_text(self) -> str:
        (first_s, first), (last_s, last) = self._rates[0], self._rates[-1]
        elapsed_s = max(last_s - first_s, _REFRESH_S)
        names = {"strain": "strain", "palm_pose": "pose", "filter/posterior": "posterior"}
        return "  ".join(f"{name} {(last[t] - first[t]) / elapsed_s:.0f}/s" for t, name in names.items())


def sweep_line(sweep: LiveSweep) -> str:
    """Summary of a sweep in one line."""
    summary = sweep.outcome()
    error_mm = summary["error_after_contact_mm"]
    error = "no contact" if error_mm is None else f"error after contact {error_mm:5.2f} mm"
    travel_mm = summary["travel_to_convergence_mm"]
    convergence = "not converged" if travel_mm is None else f"converged after {travel_mm:4.1f} mm"
    start = sweep.truth[0] * 1e3
    return f"sweep {sweep.number + 1:2d} from ({start[0]:4.1f}, {start[1]:4.1f}) mm: {error}, {convergence}"


def _place(position: np.ndarray) -> str:
    return f"x {position[0] * 1e3:6.2f} mm   y {position[1] * 1e3:6.2f} mm"
