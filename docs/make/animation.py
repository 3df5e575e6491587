"""Draws docs/images/localization.gif: the belief along a sweep of a physics engine, collapsing on contact.

`make pictures` runs it.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Ellipse, FancyBboxPatch, Patch, Rectangle

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.core.localizer import Estimate
from tactile_localizer.io.csv.recording import read_csv
from tactile_localizer.io.recording import RecordedSweep, scan_of
from tactile_localizer.io.scene_file import load_scene

PICTURE = Path(__file__).parents[1] / "images/localization.gif"
RECORDING = Path(__file__).parents[2] / "examples/recordings/engine_bump"
SCENE = load_scene(RECORDING / "scene.yaml")
MM = 1e3
FRAME_M = 0.0006
"""Travel of the palm between two frames, m."""
FRAMES_PER_S = 15
HELD_FRAMES = 25
"""Number of frames for which the end of the sweep is shown."""
CHANNEL = 5
"""Index of the strain channel that is shown, one that responds to the bump."""
COLOURS = {"index": "tab:blue", "middle": "tab:orange"}
RADIUS_95 = 2.448
"""Mahalanobis radius that contains 95 % of a two-dimensional Gaussian."""
BUMP_MM, BUMP_RADIUS_MM = (32.0, 25.4), 5.0
"""Centre, from where the fingers of the test sweeps touch it, and radius."""
SWEEP = 9
"""Sweep of the recording that is shown."""
OPEN, SURE = "#b3123f", "tab:green"


def localize(sweep: RecordedSweep) -> tuple[list[Estimate], list[tuple[np.ndarray, np.ndarray]], np.ndarray]:
    """Estimates of a sweep, the hypotheses of each frame, and the rows of the frames."""
    scan = scan_of(read_csv(RECORDING / "train.csv.gz", SCENE), SCENE)
    localizer = build_localizer(scan, SCENE, Configuration(), np.random.default_rng(1))
    x = sweep.position[:, 0]
    rows = np.searchsorted(x, np.arange(x[0], x[-1], FRAME_M))
    estimates, beliefs = [], []
    for row, sample in enumerate(zip(sweep.stamp_ns.tolist(), sweep.position, sweep.strain, strict=True)):
        estimates.append(localizer.update(*sample))
        beliefs += [localizer.hypotheses()] * int(np.count_nonzero(rows == row))
    return estimates, beliefs, rows


def draw_material(plot: Axes) -> None:
    """The bounds of the scene and the bump."""
    (left, bottom), (right, top) = SCENE.lower * MM, SCENE.upper * MM
    plot.add_patch(Rectangle((left, bottom), right - left, top - bottom, fc="none", ec="0.4", zorder=1))
    plot.add_patch(Circle(BUMP_MM, BUMP_RADIUS_MM, fc="#e8c37d", ec="#b98a2f", zorder=1))
    plot.text(*BUMP_MM, "bump", ha="center", va="center", fontsize=8, zorder=1)
    plot.set(xlim=(-7, 58), ylim=(-7, 58), aspect="equal", xlabel="x, mm", ylabel="y, mm")


def density(states: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, tuple[float, float, float, float]]:
    """The belief as an image (rows along y) of opacities, and its extent, mm."""
    (xs, column), (ys, row) = (np.unique(values, return_inverse=True) for values in states.T)
    image = np.zeros((len(ys), len(xs)))  # cells of negligible probability are left out by the filter
    image[row, column] = np.sqrt(weights / weights.max())
    return image, (xs[0] * MM, xs[-1] * MM, ys[0] * MM, ys[-1] * MM)


class Picture:
    """One frame of the animation: the palm on the material, the strain and the probability so far.

    Parameters
    ----------
    sweep, estimates : what is shown
    """

    def __init__(self, sweep: RecordedSweep, estimates: list[Estimate]) -> None:
        self.sweep, self.estimates, self.x = sweep, estimates, sweep.position[:, 0] * MM
        self.figure = plt.figure(figsize=(7.6, 3.9), layout="constrained")
        left, right = self.figure.subfigures(1, 2, width_ratios=(1, 1.05))
        self.plan, (strain, proof) = left.subplots(), right.subplots(2, 1, sharex=True)
        draw_material(self.plan)
        self.belief = self.plan.imshow(
            np.zeros((2, 2)), cmap="Reds", vmin=0, vmax=1, origin="lower", zorder=2
        )
        (self.truth,) = self.plan.plot([], [], "k+", ls="", ms=11, mew=2.2, zorder=5)
        self.region = self.plan.add_patch(Ellipse((0, 0), 1, 1, fill=False, lw=1.8, zorder=4))
        box = {"boxstyle": "round,rounding_size=2", "fc": "none", "lw": 1.6, "zorder": 3}
        self.fingers = [
            self.plan.add_patch(FancyBboxPatch((0, 0), 5, 5, ec=COLOURS[name], **box))
            for name in SCENE.phalanx_names
        ]
        handles = [self.truth, Patch(fc="tab:red"), Line2D([], [], color=OPEN, lw=1.8)]
        names = ["palm", "belief", "95 % region"]
        left.legend(handles, names, loc="outside lower center", ncols=3, frameon=False)
        self.curves = [*self._strain(strain), self._probability(proof)]

    def _strain(self, plot: Axes) -> list[tuple[Line2D, np.ndarray]]:
        """Lines of the strain of each finger, and the values along the sweep."""
        curves = []
        for name, own in zip(SCENE.phalanx_names, SCENE.layout.slices, strict=True):
            values = self.sweep.strain[:, own][:, CHANNEL]
            plot.plot(self.x, values, lw=0)
            curves.append((plot.plot([], [], color=COLOURS[name], lw=1.0, label=name)[0], values))
        plot.set(ylabel="strain, V", title=f"strain of channel {CHANNEL + 1} of each finger")
        plot.legend(frameon=False, loc="center left")
        return curves

    def _probability(self, plot: Axes) -> tuple[Line2D, np.ndarray]:
        threshold = Configuration().convergence_probability
        plot.axhline(threshold, color="0.5", ls="--", lw=0.9)
        plot.text(self.x[0] + 0.5, threshold - 0.04, "convergence threshold", color="0.4", va="top", size=8)
        plot.set(xlim=(self.x[0], self.x[-1]), ylim=(0, 1.05), xlabel="x of the palm, mm")
        plot.set_title("probability that the estimate is right")
        (line,) = plot.plot([], [], color=OPEN, lw=1.6)
        return line, np.array([estimate.probability for estimate in self.estimates])

    def show(self, row: int, belief: tuple[np.ndarray, np.ndarray]) -> None:
        """Draw one sample of the sweep."""
        estimate, place = self.estimates[row], self.sweep.position[row] * MM
        colour = SURE if estimate.converged else OPEN
        image, extent = density(*belief)
        self.belief.set(data=image, alpha=0.9 * image, extent=extent)
        self.truth.set_data(place[:1], place[1:])
        values, vectors = np.linalg.eigh(estimate.covariance)
        width, height = 2 * RADIUS_95 * np.sqrt(values) * MM
        angle = np.degrees(np.arctan2(vectors[1, 0], vectors[0, 0]))
        self.region.set(center=estimate.mean * MM, width=width, height=height, angle=angle, edgecolor=colour)
        for phalanx, finger in zip(SCENE.phalanges, self.fingers, strict=True):
            finger.set_bounds(*(place + np.multiply(phalanx.offset, MM) - 2.5), 5, 5)
        for line, along in self.curves:
            line.set_data(self.x[: row + 1], along[: row + 1])
        error = np.linalg.norm(estimate.mean * MM - place)
        text = f"converged, error {error:.1f} mm" if estimate.converged else "not converged"
        self.plan.set_title(text, color=colour)


def animate() -> None:
    """Localize along one sweep and write the animation."""
    sweep = read_csv(RECORDING / "test.csv.gz", SCENE).sweeps[SWEEP]
    estimates, beliefs, rows = localize(sweep)
    picture = Picture(sweep, estimates)

    def show(frame: int) -> None:
        shown = min(frame, len(rows) - 1)
        picture.show(int(rows[shown]), beliefs[shown])

    movie = FuncAnimation(picture.figure, show, frames=len(rows) + HELD_FRAMES)
    movie.save(PICTURE, PillowWriter(fps=FRAMES_PER_S), dpi=90)


if __name__ == "__main__":
    plt.switch_backend("Agg")
    plt.rcParams.update({"font.size": 9, "axes.titlesize": 9.5})
    animate()
