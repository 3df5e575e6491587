"""A replay as a recording for the Rerun viewer: a timeline to scrub, with the belief over the map.

Everything is drawn in millimetres on the first two axes of the scene. ``rerun-sdk`` is an optional
dependency, imported when a view is made.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from scipy.spatial import cKDTree

from tactile_localizer.core.filters.resampling import evenly
from tactile_localizer.core.localizer import Estimate, Localizer
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.tactile_map import axis_scale
from tactile_localizer.errors import MeasurementError, ScanError
from tactile_localizer.io.recording import RecordedSweep, Recording, usable
from tactile_localizer.offline.figures.axes import MM
from tactile_localizer.scene import Scene

Progress = Callable[[str, float], None]

_NEIGHBOURS = 8
"""Pairs that what the map expects at a place is the mean of."""
_SHOWN = 400
"""Hypotheses that are drawn."""
_MOST_PAIRS = 20_000
_ELLIPSE = np.linspace(0.0, 2.0 * np.pi, 49)
_REPORT_EVERY = 100
_SPACING_S = 2.0
"""Time between two sweeps on the timeline."""


class ReplayView:
    """Writes a replay into a Rerun recording.

    Parameters
    ----------
    scan, scene : the map
    path : file to write (``*.rrd``); ``None``: open the viewer

    Raises
    ------
    ScanError
        ``rerun-sdk`` is not installed, or the file cannot be written.
    """

    def __init__(self, scan: Scan, scene: Scene, path: Path | None) -> None:
        self._rr = _rerun()
        self._scene = scene
        self._record = self._rr.RecordingStream("tactile_localizer")
        try:
            if path is None:
                self._record.spawn(default_blueprint=self._blueprint())
            else:
                path.parent.mkdir(parents=True, exist_ok=True)
                self._record.save(str(path), default_blueprint=self._blueprint())
        except (OSError, RuntimeError) as error:
            reason = " ".join(str(error).split())
            raise ScanError(f"{path or 'viewer'}: expected to open it, {reason}") from None
        positions = scan.states[:, scene.columns(scan.axes)]
        self._strain = scan.strain[:, scene.channels(scan.phalanges, scan.channels)]
        self._scale = axis_scale(scene)
        self._tree = cKDTree(positions * self._scale)
        self._start_s = 0.0
        self._draw_map(positions)

    def replay(self, localizer: Localizer, recording: Recording, progress: Progress | None = None) -> int:
        """Localise each sweep of a recording and write what there is to see; returns the updates written."""
        written, done, total = 0, 0, max(len(recording), 1)
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
                if estimate.updated:
                    self._draw(sweep, row, estimate, localizer.hypotheses())
                    written += 1
                if estimate.converged != was_converged:
                    was_converged = estimate.converged
                    text = f"sweep {sweep.number}: {estimate.reason}"
                    level = "INFO" if was_converged else "WARN"
                    self._record.log("reason", self._rr.TextLog(text, level=level))
            done += len(sweep)
            self._start_s += _SPACING_S + (sweep.stamp_ns[-1] - sweep.stamp_ns[0]) * 1e-9
        if progress is not None:
            progress("replaying", 1.0)
        self._record.flush()
        return written

    def _draw_map(self, positions: np.ndarray) -> None:
        rr, every = self._rr, max(1, len(positions) // _MOST_PAIRS)
        felt = np.linalg.norm(self._strain - np.median(self._strain, axis=0), axis=1)[::every]
        shade = felt / max(float(np.quantile(felt, 0.99)), 1e-300)
        points = rr.Points2D(
            self._places(positions[::every]), colors=_colours("viridis", shade), radii=0.25, draw_order=-1.0
        )
        self._record.log("material/map", points, static=True)
        for phalanx in self._scene.phalanges:
            names = [f"{phalanx.name} {channel}" for channel in range(1, phalanx.channels + 1)]
            for kind in ("felt", "expected"):
                lines = rr.SeriesLines(names=[f"{name} {kind}" for name in names])
                self._record.log(f"strain/{phalanx.name}/{kind}", lines, static=True)

    def _draw(
        self,
        sweep: RecordedSweep,
        row: int,
        estimate: Estimate,
        hypotheses: tuple[np.ndarray, np.ndarray],
    ) -> None:
        rr, log = self._rr, self._record.log
        elapsed_s = (int(sweep.stamp_ns[row]) - int(sweep.stamp_ns[0])) * 1e-9
        self._record.set_time("time", duration=self._start_s + elapsed_s)
        states, weights = hypotheses
        drawn = states[evenly(weights, _SHOWN)]
        log("material/belief", rr.Points2D(self._places(drawn), colors=[255, 140, 0, 90], radii=0.4))
        colour = [0, 200, 0] if estimate.converged else [220, 60, 60]
        mean = self._places(estimate.mean[None])
        log("material/estimate", rr.Points2D(mean, colors=colour, radii=0.8, draw_order=20.0))
        log("material/region_95", rr.LineStrips2D([self._ellipse(estimate)], colors=colour))
        if sweep.truth is not None and np.isfinite(sweep.truth[row]).all():
            truth = rr.Points2D(
                self._places(sweep.truth[row][None]), colors=[255, 255, 255], radii=0.8, draw_order=30.0
            )
            log("material/truth", truth)
            error = float(np.linalg.norm((estimate.mean - sweep.truth[row])[: len(mean[0])])) * MM
            log("error/mm", rr.Scalars(error))
        _, near = self._tree.query(estimate.mean * self._scale, k=min(_NEIGHBOURS, len(self._strain)))
        expected = self._strain[np.atleast_1d(near)].mean(axis=0)
        for phalanx, own in zip(self._scene.phalanges, self._scene.layout.slices, strict=True):
            log(f"strain/{phalanx.name}/felt", rr.Scalars(sweep.strain[row, own]))
            log(f"strain/{phalanx.name}/expected", rr.Scalars(expected[own]))
        for name, value in estimate._asdict().items():
            if isinstance(value, float) and np.isfinite(value) and name not in ("trace", "travel"):
                log(f"explanations/{name}", rr.Scalars(value))
        log("reason/now", rr.TextDocument(f"sweep {sweep.number}: {estimate.reason}"))

    def _ellipse(self, estimate: Estimate) -> np.ndarray:
        covariance = estimate.covariance[:2, :2]
        if len(covariance) < 2:
            covariance = np.diag([covariance[0, 0], 1e-8])
        values, vectors = np.linalg.eigh(covariance)
        circle = np.stack([np.cos(_ELLIPSE), np.sin(_ELLIPSE)], axis=1)
        centre = self._places(estimate.mean[None])[0]
        return np.asarray(centre + 2.448 * MM * (circle * np.sqrt(np.maximum(values, 0.0))) @ vectors.T)

    def _places(self, states: np.ndarray) -> np.ndarray:
        """States (P, d) on the drawing: (P, 2), mm; a single axis lies along it."""
        first = states[:, :2] * self._scale[:2] * MM
        return first if first.shape[1] == 2 else np.column_stack([first, np.zeros(len(first))])

    def _blueprint(self) -> Any:
        views = self._rr.blueprint
        strains = [
            views.TimeSeriesView(origin=f"strain/{name}", name=f"{name}: felt and expected at the estimate")
            for name in self._scene.phalanx_names
        ]
        return views.Blueprint(
            views.Horizontal(
                views.Vertical(
                    views.Spatial2DView(origin="material", name="belief over the map, mm"),
                    views.TextDocumentView(origin="reason/now", name="reason"),
                    row_shares=[5, 1],
                ),
                views.Vertical(
                    *strains,
                    views.TimeSeriesView(origin="explanations", name="explanations"),
                    views.TimeSeriesView(origin="error", name="error, mm"),
                    views.TextLogView(origin="reason", name="converged or not"),
                ),
                column_shares=[1, 1],
            )
        )


def _colours(name: str, shade: np.ndarray) -> np.ndarray:
    return (255 * colormaps[name](np.clip(shade, 0.0, 1.0))).astype(np.uint8)


def _rerun() -> Any:
    try:
        import rerun
    except ImportError:
        raise ScanError("rerun-sdk: expected it for a view, found none; pip install rerun-sdk") from None
    return rerun
