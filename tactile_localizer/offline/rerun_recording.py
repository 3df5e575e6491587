"""A replay as a recording for the Rerun viewer: a timeline with the belief over the map.

Positions are drawn in millimetres on the first two axes of the scene, with the second axis upwards.
``rerun-sdk`` is an optional dependency, imported when a view is made.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from scipy.spatial import cKDTree

from tactile_localizer.core.filters.resampling import representative
from tactile_localizer.core.localizer import Estimate, Localizer
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.tactile_map import axis_scale
from tactile_localizer.errors import MeasurementError, ScanError
from tactile_localizer.io.recording import RecordedSweep, Recording, usable
from tactile_localizer.offline.axes import MM, display_units
from tactile_localizer.scene import Scene

Progress = Callable[[str, float], None]

_NEIGHBOURS = 8
"""Number of nearest pairs whose mean strain is expected at a position."""
_SHOWN = 400
"""Number of hypotheses drawn."""
_MAX_PAIRS = 20_000
_ELLIPSE = np.linspace(0.0, 2.0 * np.pi, 49)
_RADIUS_95 = 2.448
"""Mahalanobis radius of the 95 % region of a Gaussian on two axes."""
_MARGIN_MM = 8.0
_REPORT_EVERY = 100
_AHEAD = 0.35
"""Time shown after the cursor, in sweep durations, which leaves room for the legend."""

_CONVERGED, _UNCONVERGED, _TRUE = [60, 220, 90], [235, 80, 80], [255, 255, 255]
_BELIEF = [255, 140, 0, 200]
_EXPLANATIONS = {
    "map": ("the map", _CONVERGED),
    "unknown": ("unknown material", _UNCONVERGED),
    "featureless": ("featureless material off the map", [150, 150, 150]),
}
"""Displayed name and colour of each explanation, by the name in its path."""
_EXPECTED_BRIGHTNESS = 0.45
"""Brightness of the line of expected strain relative to that of measured strain."""


class ReplayView:
    """Writes a replay into a Rerun recording.

    Parameters
    ----------
    scan, scene : scan and scene of the map
    path : file to write (``*.rrd``)

    Raises
    ------
    ScanError
        ``rerun-sdk`` is not installed, or the file cannot be written.
    """

    def __init__(self, scan: Scan, scene: Scene, path: Path) -> None:
        self._rr = _rerun()
        self._scene = scene
        self._record = self._rr.RecordingStream("tactile_localizer")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._record.save(str(path))
        except (OSError, RuntimeError) as error:
            reason = " ".join(str(error).split())
            raise ScanError(f"{path}: expected to write it, {reason}") from None
        self._positions = scan.positions_on(scene)
        self._strain = scan.strain_on(scene)
        self._scale = axis_scale(scene)
        self._tree = cKDTree(self._positions * self._scale)

    def replay(self, localizer: Localizer, recording: Recording, progress: Progress | None = None) -> int:
        """Localize each sweep of a recording and write every measurement update; returns their number."""
        duration_s = _median_duration_s(recording)
        self._record.send_blueprint(self._blueprint(duration_s))
        self._draw_map()
        start_s, written, done, total = 0.0, 0, 0, max(len(recording), 1)
        for sweep in recording.sweeps:
            localizer.reset()
            was_converged = False
            for row in range(len(sweep)):
                if progress is not None and row % _REPORT_EVERY == 0:
                    progress("replaying", (done + row) / total)
                position, present = sweep.position[row], usable(sweep.status[row])
                try:
                    estimate = localizer.update(
                        int(sweep.stamp_ns[row]), position, sweep.strain[row], present
                    )
                except MeasurementError:
                    continue
                self._record.set_time("time", duration=start_s + _elapsed_s(sweep, row))
                if estimate.updated:
                    self._draw(sweep, row, estimate, localizer)
                    written += 1
                if estimate.converged != was_converged:
                    was_converged = estimate.converged
                    text = f"sweep {sweep.number}: {estimate.reason}"
                    level = "INFO" if was_converged else "WARN"
                    self._record.log("log", self._rr.TextLog(text, level=level))
            done += len(sweep)
            if len(sweep):
                self._end_sweep(start_s + _elapsed_s(sweep, -1), duration_s)
                start_s += _elapsed_s(sweep, -1) + duration_s
        if progress is not None:
            progress("replaying", 1.0)
        self._record.flush()
        return written

    def _draw_map(self) -> None:
        rr, every = self._rr, max(1, len(self._positions) // _MAX_PAIRS)
        change = np.linalg.norm(self._strain - np.median(self._strain, axis=0), axis=1)[::every]
        shade = change / max(float(np.quantile(change, 0.99)), 1e-300)
        places = self._places(self._positions[::every])
        points = rr.Points2D(places, colors=_colours("viridis", shade), radii=0.25, draw_order=-1.0)
        self._record.log("material/map", points, static=True)
        self._record.log("material/axes", self._axes(places), static=True)
        for phalanx in self._scene.phalanges:
            colours = _channel_colours(phalanx.channels)
            for kind, brightness in (("measured", 1.0), ("expected", _EXPECTED_BRIGHTNESS)):
                names = [f"channel {channel} {kind}" for channel in range(1, phalanx.channels + 1)]
                shaded = (brightness * colours).astype(np.uint8)
                lines = rr.SeriesLines(
                    names=names, colors=shaded, widths=[1.5 * brightness + 0.5] * len(names)
                )
                self._record.log(f"strain/{phalanx.name}/{kind}", lines, static=True)
        lines = {
            f"{path}/{name}": look
            for path in ("probability", "log_likelihood")
            for name, look in _EXPLANATIONS.items()
        }
        lines["probability/converged"] = "within the convergence radius", _TRUE
        lines["error/estimate"] = "error of the estimate", _TRUE
        lines["error/region_95"] = "radius of the 95 % region", _BELIEF[:3]
        for path, (name, colour) in lines.items():
            self._record.log(path, rr.SeriesLines(names=name, colors=[colour]), static=True)

    def _axes(self, places: np.ndarray) -> Any:
        """Arrows of 10 mm beside the map, named after the axes."""
        corner = np.array([places[:, 0].min() - 4.0, places[:, 1].max() + 4.0])
        names = [axis.name for axis in self._scene.axes[:2]]
        vectors = np.array([[10.0, 0.0], [0.0, -10.0]])[: len(names)]
        degrees = np.degrees(10.0 / (self._scale * MM))
        labels = [
            f"{name} {degrees[i]:.0f}°" if name == "yaw" else f"{name} 10 mm" for i, name in enumerate(names)
        ]
        return self._rr.Arrows2D(
            vectors=vectors, origins=[corner] * len(names), labels=labels, colors=[[160, 160, 160]], radii=0.2
        )

    def _draw(self, sweep: RecordedSweep, row: int, estimate: Estimate, localizer: Localizer) -> None:
        rr, log = self._rr, self._record.log
        states, weights = localizer.hypotheses()
        drawn = self._places(states[representative(weights, _SHOWN)])
        log("material/belief", rr.Points2D(drawn, colors=_BELIEF, radii=0.4))
        colour = _CONVERGED if estimate.converged else _UNCONVERGED
        mean, region = self._places(estimate.mean[None]), self._region(estimate)
        log("material/estimate", rr.Points2D(mean, colors=colour, radii=0.8, draw_order=20.0))
        log("material/region_95", rr.LineStrips2D([region], colors=colour, radii=0.2, draw_order=10.0))
        log("error/region_95", rr.Scalars(float(np.linalg.norm(region - mean, axis=1).max())))
        if sweep.truth is not None and np.isfinite(sweep.truth[row]).all():
            truth = self._places(sweep.truth[row][None])
            log("material/truth", rr.Points2D(truth, colors=_TRUE, radii=0.6, draw_order=30.0))
            log("error/estimate", rr.Scalars(float(np.linalg.norm(mean - truth))))
        _, near = self._tree.query(estimate.mean * self._scale, k=min(_NEIGHBOURS, len(self._strain)))
        expected = self._strain[np.atleast_1d(near)].mean(axis=0)
        for phalanx, channels in zip(self._scene.phalanges, self._scene.layout.slices, strict=True):
            log(f"strain/{phalanx.name}/measured", rr.Scalars(sweep.strain[row, channels]))
            log(f"strain/{phalanx.name}/expected", rr.Scalars(expected[channels]))
        log_likelihoods = estimate.log_marginal, estimate.log_unknown, estimate.log_featureless
        explained = localizer.explanations
        probabilities = explained.on_map, explained.unknown, explained.featureless
        for name, probability, log_likelihood in zip(
            _EXPLANATIONS, probabilities, log_likelihoods, strict=True
        ):
            log(f"probability/{name}", rr.Scalars(probability))
            if np.isfinite(log_likelihood):
                log(f"log_likelihood/{name}", rr.Scalars(log_likelihood))
        log("probability/converged", rr.Scalars(estimate.probability))
        log("reason", rr.TextDocument(self._explained(sweep.number, estimate), media_type="text/markdown"))

    def _explained(self, sweep: int, estimate: Estimate) -> str:
        names, units = (
            self._scene.axis_names,
            ["°" if name == "yaw" else " mm" for name in self._scene.axis_names],
        )
        place = ", ".join(
            f"{name} {display_units(name, value):.1f}{unit}"
            for name, unit, value in zip(names, units, estimate.mean, strict=True)
        )
        return f"**sweep {sweep}**, {MM * estimate.travel:.1f} mm of travel, {place}\n\n{estimate.reason}"

    def _end_sweep(self, end_s: float, pause_s: float) -> None:
        """Clear the sweep's data, so that no line continues into the pause before the next sweep."""
        self._record.set_time("time", duration=end_s + 0.1 * pause_s)
        drawn = ("belief", "estimate", "region_95", "truth")
        for path in (
            *(f"material/{name}" for name in drawn),
            "strain",
            "probability",
            "log_likelihood",
            "error",
        ):
            self._record.log(path, self._rr.Clear(recursive=True))

    def _region(self, estimate: Estimate) -> np.ndarray:
        """Outline (n, 2) of the 95 % region, mm."""
        scale = np.diag(self._scale[:2] * MM)
        covariance = scale @ estimate.covariance[:2, :2] @ scale if len(self._scale) > 1 else None
        if covariance is None:
            covariance = np.diag([estimate.covariance[0, 0] * (self._scale[0] * MM) ** 2, 1e-2])
        values, vectors = np.linalg.eigh(covariance)
        circle = np.stack([np.cos(_ELLIPSE), np.sin(_ELLIPSE)], axis=1)
        outline = _RADIUS_95 * (circle * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
        return np.asarray(self._places(estimate.mean[None])[0] + outline * [1.0, -1.0])

    def _places(self, states: np.ndarray) -> np.ndarray:
        """Positions (P, 2) in the view of states (P, d), mm; a single axis is horizontal."""
        first = states[:, :2] * self._scale[:2] * MM
        second = (
            -first[:, 1] if first.shape[1] == 2 else np.zeros(len(first))
        )  # the view's second axis is downwards
        return np.column_stack([first[:, 0], second])

    def _blueprint(self, duration_s: float) -> Any:
        """Layout: the map on the left, time series on the right.

        Plots show ``duration_s`` before the cursor.
        """
        rr, views = self._rr, self._rr.blueprint
        shown = rr.TimeRange(
            start=rr.TimeRangeBoundary.cursor_relative(seconds=-duration_s),
            end=rr.TimeRangeBoundary.cursor_relative(seconds=_AHEAD * duration_s),
        )

        def plot(origin: str, name: str, **kwargs: Any) -> Any:
            options = {"plot_legend": views.Corner2D.RightTop, **kwargs}
            axis = views.TimeAxis(view_range=shown)
            return views.TimeSeriesView(origin=origin, name=name, axis_x=axis, **options)

        corners = self._places(np.array([self._scene.lower, self._scene.upper]))
        least, most = corners.min(axis=0) - _MARGIN_MM, corners.max(axis=0) + _MARGIN_MM
        bounds = views.VisualBounds2D(x_range=(least[0], most[0]), y_range=(least[1], most[1]))
        strains = [
            plot(
                f"strain/{name}",
                f"{name}: strain, V; dark: expected at the estimate",
                plot_legend=views.PlotLegend(visible=False),
            )
            for name in self._scene.phalanx_names
        ]
        return views.Blueprint(
            views.Horizontal(
                views.Vertical(
                    views.Spatial2DView(origin="material", name="belief over the map", visual_bounds=bounds),
                    views.TextDocumentView(origin="reason", name="decision"),
                    views.TextLogView(origin="log", name="converged and lost"),
                    row_shares=[5, 1, 1],
                ),
                views.Vertical(
                    *strains,
                    plot(
                        "probability",
                        "probability of the explanations",
                        axis_y=views.ScalarAxis(range=(-0.05, 1.05), zoom_lock=True),
                    ),
                    plot("log_likelihood", "log-likelihood of a measurement, nats"),
                    plot("error", "error, mm"),
                ),
                column_shares=[1, 1],
            ),
            views.BlueprintPanel(state="collapsed"),
            views.SelectionPanel(state="collapsed"),
            views.TimePanel(state="collapsed", timeline="time"),
        )


def _elapsed_s(sweep: RecordedSweep, row: int) -> float:
    return (int(sweep.stamp_ns[row]) - int(sweep.stamp_ns[0])) * 1e-9


def _median_duration_s(recording: Recording) -> float:
    durations_s = [_elapsed_s(sweep, -1) for sweep in recording.sweeps if len(sweep)]
    return max(float(np.median(durations_s)) if durations_s else 0.0, 0.1)


def _channel_colours(count: int) -> np.ndarray:
    """Distinct colours (count, 3), 0 to 255."""
    if count <= 8:
        return 255 * colormaps["Set2"](np.arange(count))[:, :3]
    return 255 * colormaps["hsv"](np.arange(count) / count)[:, :3]


def _colours(name: str, shade: np.ndarray) -> np.ndarray:
    return (255 * colormaps[name](np.clip(shade, 0.0, 1.0))).astype(np.uint8)


def _rerun() -> Any:
    try:
        import rerun
    except ImportError:
        raise ScanError(
            "rerun-sdk: expected it to be installed (pip install 'rerun-sdk>=0.41,<0.42'), found none"
        ) from None
    return rerun
