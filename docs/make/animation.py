"""Draws docs/images/localization.gif: the belief along a sweep of a physics engine, collapsing on contact.

`make pictures` runs it.
"""

from itertools import pairwise
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Ellipse, Patch, Polygon, Rectangle
from matplotlib.transforms import Affine2D

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
FRAME_M = 0.0008
"""Travel of the palm between two frames, m."""
FRAMES_PER_S = 12
HELD_FRAMES = 20
"""Number of frames for which the end of the sweep is shown."""
CHANNEL = 5
"""Index of the strain channel that is shown, one that responds to the bump."""
COLOURS = {"index": "tab:blue", "middle": "tab:orange"}
RADIUS_95 = 2.448
"""Mahalanobis radius that contains 95 % of a two-dimensional Gaussian."""
BUMP_MM, BUMP_RADIUS_MM = (32.0, 25.4), 5.0
"""Centre, from where the fingers of the test sweeps touch it, and radius."""
NOISE, STRONG = 0.25, 0.9
"""Strain at which a finger begins to have colour, and at which it has all of it, V."""
SWEEP = 9
"""Sweep of the recording that is shown."""
OPEN, SURE = "#b3123f", "tab:green"
CLOTH, THREAD, METAL = "#efe6d6", "#d9ccb4", "#c9ced6"


def localize(sweep: RecordedSweep) -> tuple[list[Estimate], list[tuple[np.ndarray, np.ndarray]], np.ndarray]:
    """Estimates of a sweep, the hypotheses of each frame, and the rows of the frames."""
    scan = scan_of(read_csv(RECORDING / "train.csv.gz", SCENE), SCENE)
    localizer = build_localizer(scan, SCENE, Configuration(), np.random.default_rng(1))
    x = sweep.position[:, 0]
    rows = np.searchsorted(x, np.arange(x[0], x[-1], FRAME_M))
    estimates, beliefs = [], []
    for row, sample in enumerate(sweep.samples()):
        estimates.append(localizer.update(*sample))
        beliefs += [localizer.hypotheses()] * int(np.count_nonzero(rows == row))
    return estimates, beliefs, rows


def capsule(start: tuple[float, float], end: tuple[float, float], width: float) -> np.ndarray:
    """Outline (n, 2) of a link from ``start`` to ``end`` with round ends, mm."""
    start, along = np.array(start), np.subtract(end, start)
    angle = np.arctan2(along[1], along[0])
    arc = np.linspace(np.pi / 2, 3 * np.pi / 2, 20) + angle
    cap = width / 2 * np.column_stack([np.cos(arc), np.sin(arc)])
    return np.concatenate([start + cap, start + along - cap])


def cloth(plot: Axes) -> None:
    """A sheet of cloth with its threads, and the bump in it."""
    y = np.linspace(-22, 73, 60)
    edges = [-24 + np.sin(y / 9), 61 + 0.8 * np.sin(y / 7 + 1)]
    outline = np.concatenate(
        [np.column_stack([x, each]) for x, each in zip(edges, (y, y[::-1]), strict=True)]
    )
    sheet = plot.add_patch(Polygon(outline, fc=CLOTH, ec=THREAD, lw=1.2, zorder=0))
    for place in np.arange(-24, 64, 3.0):
        plot.plot(place + 0.5 * np.sin(y / 11), y, color=THREAD, lw=0.5, zorder=0)[0].set_clip_path(sheet)
    x = np.linspace(-26, 63, 60)
    for place in np.arange(-22, 74, 3.0):
        plot.plot(x, place + 0.5 * np.sin(x / 13), color=THREAD, lw=0.5, zorder=0)[0].set_clip_path(sheet)
    for radius, shade in zip(np.linspace(1.25, 0.35, 6), np.linspace(0.1, 0.6, 6), strict=True):
        plot.add_patch(
            Circle(BUMP_MM, BUMP_RADIUS_MM * radius, fc="#b98a2f", ec="none", alpha=shade, zorder=1)
        )
    plot.text(
        BUMP_MM[0], BUMP_MM[1] - 9, "bump", ha="center", va="center", fontsize=8, color="#7a5a1b", zorder=1
    )
    plot.set(xlim=(-52, 63), ylim=(-24, 75), aspect="equal")
    plot.axis("off")


def hand(plot: Axes) -> tuple[list[Polygon], list[Polygon]]:
    """A hand on the cloth, its palm frame at the origin: all of its parts, and the load cells' phalanges."""
    wrist = [capsule((-120, 0), (-70, 0), 26), capsule((-62, 9), (-62, -9), 34)]
    parts = [Polygon(link, fc=METAL, ec="0.35", lw=1.1, zorder=3) for link in wrist]
    thumb = Polygon(capsule((-48, 0), (-3, 0), 13), fc="none", ec="0.35", lw=1.0, ls=(0, (3, 2)), zorder=2)
    parts.append(thumb)  # beneath the cloth
    cells = []
    for phalanx in SCENE.phalanges:
        _, side = np.multiply(phalanx.offset, MM)
        joints = [(-48, 0.9 * side), (-27, 1.25 * side), (-8, 1.1 * side)]
        for start, end in pairwise(joints):
            parts.append(Polygon(capsule(start, end, 10.5), fc=METAL, ec="0.35", lw=1.1, zorder=4))
        tip = Polygon(
            capsule(joints[-1], (0.0, side), 10.5), fc="w", ec=COLOURS[phalanx.name], lw=1.8, zorder=5
        )
        cells.append(tip)
    for part in (*parts, *cells):
        plot.add_patch(part)
    return [*parts, *cells], cells


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
        self.figure = plt.figure(figsize=(8.6, 5.4), layout="constrained")
        above, below = self.figure.subfigures(2, 1, height_ratios=(1.5, 1))
        self.scene, self.plan = above.subplots(1, 2, width_ratios=(1.25, 1))
        strain, proof = below.subplots(1, 2)
        cloth(self.scene)
        self.hand, self.cells = hand(self.scene)
        self.scene.set_title("thumb below, two fingers above: the hand slides")
        (left, bottom), (right, top) = SCENE.lower * MM, SCENE.upper * MM
        self.plan.add_patch(Rectangle((left, bottom), right - left, top - bottom, fc="none", ec="0.4"))
        self.plan.set(xlim=(-7, 58), ylim=(-7, 58), aspect="equal", xlabel="x, mm", ylabel="y, mm")
        self.belief = self.plan.imshow(
            np.zeros((2, 2)), cmap="Reds", vmin=0, vmax=1, origin="lower", zorder=2
        )
        self.truth = [
            plot.plot([], [], "k+", ls="", ms=11, mew=2.2, zorder=6)[0] for plot in (self.plan, self.scene)
        ]
        self.region = self.plan.add_patch(Ellipse((0, 0), 1, 1, fill=False, lw=1.8, zorder=4))
        handles = [self.truth[0], Patch(fc="tab:red"), Line2D([], [], color=OPEN, lw=1.8)]
        names = ["palm", "belief", "95 % region"]
        self.plan.legend(handles, names, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
        self.curves = [*self._strain(strain), self._probability(proof)]

    def _strain(self, plot: Axes) -> list[tuple[Line2D, np.ndarray]]:
        """Lines of the strain of each finger, and the values along the sweep."""
        curves = []
        for name, own in zip(SCENE.phalanx_names, SCENE.layout.slices, strict=True):
            values = self.sweep.strain[:, own][:, CHANNEL]
            plot.plot(self.x, values, lw=0)
            curves.append((plot.plot([], [], color=COLOURS[name], lw=1.0, label=name)[0], values))
        plot.set(xlim=(self.x[0], self.x[-1]), xlabel="x of the palm, mm", ylabel="strain, V")
        plot.set_title("what the fingers feel: one of 8 channels each")
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
        for cross in self.truth:
            cross.set_data(place[:1], place[1:])
        values, vectors = np.linalg.eigh(estimate.covariance)
        width, height = 2 * RADIUS_95 * np.sqrt(values) * MM
        angle = np.degrees(np.arctan2(vectors[1, 0], vectors[0, 0]))
        self.region.set(center=estimate.mean * MM, width=width, height=height, angle=angle, edgecolor=colour)
        for part in self.hand:
            part.set_transform(Affine2D().translate(*place) + self.scene.transData)
        for cell, own in zip(self.cells, SCENE.layout.slices, strict=True):
            rest, felt = np.median(self.sweep.strain[:200, own], axis=0), self.sweep.strain[row, own]
            strength = np.clip((np.linalg.norm(felt - rest) - NOISE) / (STRONG - NOISE), 0.0, 1.0)
            cell.set_facecolor(1.0 - strength * (1.0 - np.array(to_rgb(cell.get_edgecolor()))))
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
    movie.save(PICTURE, PillowWriter(fps=FRAMES_PER_S), dpi=80)


if __name__ == "__main__":
    plt.switch_backend("Agg")
    plt.rcParams.update({"font.size": 9, "axes.titlesize": 9.5})
    animate()
