"""A replay as a recording for the Rerun viewer: a timeline with the belief over the map.

Positions are drawn in millimetres on the first two axes of the scene, with the second axis upwards.
``rerun-sdk`` is an optional dependency, imported when a view is made.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps

from tactile_localizer.core.filters.resampling import representative
from tactile_localizer.core.localizer import Estimate, Localizer
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import ScanError
from tactile_localizer.io.recording import RecordedSweep
from tactile_localizer.offline.axes import MM, display_units
from tactile_localizer.scene import Scene

_SHOWN = 400
"""Number of hypotheses drawn."""
_MAX_PAIRS = 20_000
_ANGLES = np.linspace(0.0, 2.0 * np.pi, 49)
_CIRCLE = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)])
_RADIUS_95 = 2.448
"""Mahalanobis radius of the 95 % region of a Gaussian on two axes."""
_PAUSE_S = 1.0
"""Time between sweeps on the timeline."""

_CONVERGED, _UNCONVERGED, _TRUE = [60, 220, 90], [235, 80, 80], [255, 255, 255]
_BELIEF = [255, 140, 0, 200]


class ReplayView:
    """Writes a replay into a Rerun recording. Close it after use.

    Parameters
    ----------
    scan : scan of the map
    localizer : localizer on that scan
    path : file to write (``*.rrd``)

    Raises
    ------
    ScanError
        ``rerun-sdk`` is not installed, or the file cannot be written.
    """

    def __init__(self, scan: Scan, localizer: Localizer, path: Path) -> None:
        self._rr = _rerun()
        self._localizer = localizer
        self._scene = localizer.scene
        self._scale = _axis_scale(localizer.scene)
        self._record = self._rr.RecordingStream("tactile_localizer")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._record.save(str(path))
        except (OSError, RuntimeError) as error:
            reason = " ".join(str(error).split())
            raise ScanError(f"{path}: expected to write it, {reason}") from None
        self._record.send_blueprint(self._blueprint())
        self._draw_map(scan)
        self._sweep: RecordedSweep | None = None
        self._start_s = self._now_s = 0.0

    def close(self) -> None:
        """Complete the file."""
        self._record.flush()

    def _draw_map(self, scan: Scan) -> None:
        positions, strain = scan.positions_on(self._scene), scan.strain_on(self._scene)
        every = max(1, len(positions) // _MAX_PAIRS)
        change = np.linalg.norm(strain - np.median(strain, axis=0), axis=1)[::every]
        shade = np.clip(change / max(float(np.quantile(change, 0.99)), 1e-300), 0.0, 1.0)
        colours = (255 * colormaps["viridis"](shade)).astype(np.uint8)
        points = self._rr.Points2D(
            self._places(positions[::every]), colors=colours, radii=0.25, draw_order=-1.0
        )
        self._record.log("material/map", points, static=True)

    def observe(self, sweep: RecordedSweep, row: int, estimate: Estimate) -> None:
        """Write the measurement update of a sample, for :func:`~.offline.replay.replay`."""
        if sweep is not self._sweep:
            self._begin(sweep)
        if not estimate.updated:
            return
        self._now_s = self._start_s + (int(sweep.stamp_ns[row]) - int(sweep.stamp_ns[0])) * 1e-9
        self._record.set_time("time", duration=self._now_s)
        self._draw_belief(estimate)
        self._draw_hand(sweep, row, estimate)
        self._draw_explanations(sweep, estimate)

    def _begin(self, sweep: RecordedSweep) -> None:
        """Start a sweep on the timeline, and clear the one before, so that no line continues into it."""
        if self._sweep is not None:
            self._record.set_time("time", duration=self._now_s + 0.1 * _PAUSE_S)
            for path in ("material", "strain", "probability", "error"):
                self._record.log(path, self._rr.Clear(recursive=True))
            self._start_s = self._now_s + _PAUSE_S
        self._sweep = sweep

    def _draw_belief(self, estimate: Estimate) -> None:
        rr = self._rr
        states, weights = self._localizer.hypotheses()
        places = self._places(states[representative(weights, _SHOWN)])
        self._record.log("material/belief", rr.Points2D(places, colors=_BELIEF, radii=0.4))
        colour = _CONVERGED if estimate.converged else _UNCONVERGED
        region = rr.LineStrips2D([self._region(estimate)], colors=colour, radii=0.2, draw_order=10.0)
        self._record.log("material/region_95", region)

    def _draw_hand(self, sweep: RecordedSweep, row: int, estimate: Estimate) -> None:
        rr, log = self._rr, self._record.log
        colour = _CONVERGED if estimate.converged else _UNCONVERGED
        place = self._places(estimate.mean[None])
        log("material/estimate", rr.Points2D(place, colors=colour, radii=0.8, draw_order=20.0))
        if sweep.truth is not None and np.isfinite(sweep.truth[row]).all():
            truth = self._places(sweep.truth[row][None])
            log("material/truth", rr.Points2D(truth, colors=_TRUE, radii=0.6, draw_order=30.0))
            log("error/estimate", rr.Scalars(float(np.linalg.norm(place - truth))))
        for phalanx, channels in zip(self._scene.phalanges, self._scene.layout.slices, strict=True):
            log(f"strain/{phalanx.name}", rr.Scalars(sweep.strain[row, channels]))

    def _draw_explanations(self, sweep: RecordedSweep, estimate: Estimate) -> None:
        rr, log = self._rr, self._record.log
        explained = self._localizer.explanations
        for name, probability in (
            ("converged", estimate.probability),
            ("map", explained.on_map),
            ("unknown", explained.unknown),
            ("featureless", explained.featureless),
        ):
            log(f"probability/{name}", rr.Scalars(probability))
        place = ", ".join(
            f"{name} {display_units(name, value):.1f}{'°' if name == 'yaw' else ' mm'}"
            for name, value in zip(self._scene.axis_names, estimate.mean, strict=True)
        )
        text = f"**sweep {sweep.number}**, {MM * estimate.travel:.1f} mm of travel, {place}\n\n"
        log("reason", rr.TextDocument(text + estimate.reason, media_type="text/markdown"))

    def _region(self, estimate: Estimate) -> np.ndarray:
        """Outline (n, 2) of the 95 % region in the view, mm; a line on a single axis."""
        values, vectors = np.linalg.eigh(estimate.covariance[:2, :2])
        outline = (_CIRCLE[:, : len(values)] * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
        return self._places(estimate.mean[:2] + _RADIUS_95 * outline)

    def _places(self, states: np.ndarray) -> np.ndarray:
        """Positions (P, 2) in the view of states (P, d), mm; a single axis is horizontal."""
        places = np.zeros((len(states), 2))
        shown = states[:, :2] * self._scale[:2] * MM
        places[:, : shown.shape[1]] = shown
        return places * [1.0, -1.0]  # the view's second axis is downwards

    def _blueprint(self) -> Any:
        """Layout: the map and the decision on the left, time series on the right."""
        views = self._rr.blueprint
        material = views.Vertical(
            views.Spatial2DView(origin="material", name="belief over the map"),
            views.TextDocumentView(origin="reason", name="decision"),
            row_shares=[5, 1],
        )
        plots = [
            *((f"strain/{name}", f"{name}: strain") for name in self._scene.phalanx_names),
            ("probability", "probability of the explanations"),
            ("error", "error, mm"),
        ]
        series = [views.TimeSeriesView(origin=origin, name=name) for origin, name in plots]
        return views.Blueprint(views.Horizontal(material, views.Vertical(*series)), collapse_panels=True)


def _rerun() -> Any:
    try:
        import rerun
    except ImportError:
        raise ScanError(
            "rerun-sdk: expected it to be installed (pip install 'rerun-sdk>=0.41,<0.42'), found none"
        ) from None
    return rerun


def _axis_scale(scene: Scene) -> np.ndarray:
    """Display scale of each axis, (d,): 1 for lengths; yaw is scaled to the extent of the longest of them."""
    extent = scene.extent
    angle = np.array([axis.name == "yaw" for axis in scene.axes])
    if angle.all() or not angle.any():
        return np.ones(len(extent))
    return np.where(angle, extent[~angle].max() / extent, 1.0)
