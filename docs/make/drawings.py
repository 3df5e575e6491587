"""Draws pictures of the simulated hand into docs/images, for concepts.md and material.md.

`make pictures` runs it.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, FancyArrowPatch, FancyBboxPatch, Rectangle

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.core.scan.tactile_map import make_map
from tactile_localizer.io.recording import scan_of
from tactile_localizer.offline.figures.replay import CONVERGED, SEARCHING, WRONG, draw_paths
from tactile_localizer.offline.replay import replay
from tactile_localizer.offline.verdict import judge
from tactile_localizer.sim import shipped_scene, simulate_recording, simulate_scan, simulate_sweep

IMAGES = Path(__file__).parents[1] / "images"
SCENE = shipped_scene("bump")
MM = 1e3
INDEX, MIDDLE, PALM, FEATURE = "tab:blue", "tab:orange", "0.25", "#f3d9a4"
STRAIN = 5
"""The strain channel that is shown, one that responds to the bump."""


def arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float], colour: str, style: str) -> None:
    """An arrow between two places."""
    axes.add_patch(FancyArrowPatch(start, end, arrowstyle=style, mutation_scale=9, color=colour, lw=1.3))


def material(axes: Axes, region: bool = True) -> None:
    """The bounds of the palm, and the area in which the fingers touch the feature."""
    assert SCENE.feature is not None
    (left, bottom), (right, top) = SCENE.lower * MM, SCENE.upper * MM
    axes.add_patch(Rectangle((left, bottom), right - left, top - bottom, fill=False, lw=1.0, ec="0.4"))
    if region:
        low, high = np.multiply(SCENE.feature.lower, MM), np.multiply(SCENE.feature.upper, MM)
        axes.add_patch(Rectangle(tuple(low), *(high - low), fc=FEATURE, ec="none", zorder=0))
    axes.set_aspect("equal")
    axes.set_xlabel("x, mm")
    axes.set_ylabel("y, mm")


def frames() -> None:
    """Palm, phalanges, material and reference frame, seen from above."""
    figure, axes = plt.subplots(figsize=(6.8, 4.0), layout="constrained")
    material(axes)
    palm = np.array([21.0, 25.0])
    axes.add_patch(Circle((32.0, 25.4), 5.5, fc="#e0b765", ec="#b98a2f"))
    axes.text(32.0, 25.4, "bump", ha="center", va="center")
    axes.text(46.8, 7.0, "feature region\n(of the phalanges)", ha="right", va="bottom", color="#8a6620")
    for phalanx, colour in zip(SCENE.phalanges, (INDEX, MIDDLE), strict=True):
        place = palm + np.multiply(phalanx.offset, MM)
        axes.add_patch(
            FancyBboxPatch(
                place - (3, 3.2), 6, 6.4, boxstyle="round,rounding_size=2", fc="white", ec=colour, lw=1.6
            )
        )
        axes.text(*place, phalanx.name, ha="center", va="center", color=colour, fontsize=7.5)
        arrow(axes, tuple(palm), tuple(place - np.sign(place - palm) * (0, 3.4)), colour, "-|>")
    axes.text(palm[0] - 1.0, palm[1] + 5.4, "offset", ha="right", color=INDEX)
    axes.plot(*palm, "o", color=PALM)
    axes.text(palm[0] + 1.0, palm[1] - 2.8, "palm", color=PALM, weight="bold", fontsize=8)
    arrow(axes, (0.0, 0.0), tuple(palm), PALM, "-|>")
    axes.text(11.2, 11.6, "state", color=PALM, rotation=50, ha="center", va="center")
    for end, name in (((9.0, 0.0), "x"), ((0.0, 9.0), "y")):
        arrow(axes, (0.0, 0.0), end, "black", "-|>")
        axes.text(end[0] + 1.0, end[1] + 1.0, name, weight="bold")
    axes.text(-2.4, -4.4, "material frame", weight="bold")
    base = np.array([-33.0, -2.0])
    for end, place, name in (((9, 0), (9.4, -3.2), "x"), ((0, 9), (0.8, 9.8), "y")):
        arrow(axes, tuple(base), tuple(np.add(base, end)), "black", "-|>")
        axes.text(*np.add(base, place), name, weight="bold")
    axes.text(base[0], base[1] - 4.4, "reference frame", weight="bold", ha="center")
    arrow(axes, tuple(base), (0.0, 0.0), "tab:green", "-|>")
    axes.text(-14.0, -7.0, "material_pose,\nto scan with", ha="center", color="tab:green")
    arrow(axes, tuple(base), tuple(palm), "tab:purple", "-|>")
    axes.text(-20.0, 11.0, "palm_pose, what\nthe arm reports", ha="center", color="tab:purple")
    axes.annotate(
        "bounds", (50.0, 51.8), (54.5, 47.0), color="0.4", arrowprops={"arrowstyle": "-", "color": "0.4"}
    )
    axes.set_xlim(-43, 62)
    axes.set_ylim(-9, 53)
    axes.axis("off")
    save(figure, "frames")


def scan() -> None:
    """A training scan: its sweeps, and one strain channel along three of them."""
    recorded = simulate_recording("bump", seed=1)
    figure, (above, along) = plt.subplots(
        1, 2, figsize=(7.6, 3.1), layout="constrained", width_ratios=(1, 1.45)
    )
    material(above, region=False)
    every = scan_of(recorded, SCENE)
    x, y = every.states[::4].T * MM
    colours = above.scatter(x, y, 1.5, every.strain[::4, STRAIN], cmap="viridis")
    figure.colorbar(colours, ax=above, label="strain, V", shrink=0.8)
    above.set_title(f"pairs of 21 sweeps, coloured by index {STRAIN + 1}")
    for number in (9, 10, 11):
        sweep = recorded.sweeps[number]
        label = f"y = {sweep.position[:, 1].mean() * MM:.1f} mm"
        along.plot(sweep.position[:, 0] * MM, sweep.strain[:, STRAIN], lw=0.8, label=label)
    along.axvspan(*(np.array([SCENE.feature.lower[0], SCENE.feature.upper[0]]) * MM), color=FEATURE, zorder=0)
    along.set_xlabel("x, mm")
    along.set_ylabel("strain, V (shaded: feature region)")
    along.set_title(f"index {STRAIN + 1} along three neighbouring sweeps")
    along.legend(frameon=False)
    save(figure, "scan")


def belief() -> None:
    """The belief along one new sweep, and the probabilities that determine convergence."""
    training = simulate_scan("bump", seed=1)
    localizer = build_localizer(training, SCENE, Configuration(), np.random.default_rng(1))
    sweep = simulate_sweep("bump", seed=1, number=0, start=(0.002, 0.0241))
    estimates, pictures = [], {}
    shown = np.searchsorted(sweep.truth[:, 0], (0.012, 0.022, 0.027, 0.042))
    for row, (stamp, position, strain) in enumerate(
        zip(sweep.stamp_ns, sweep.position, sweep.strain, strict=True)
    ):
        estimates.append(localizer.update(int(stamp), position, strain))
        if row in shown:
            pictures[row] = localizer.hypotheses()
    figure = plt.figure(figsize=(7.6, 4.6), layout="constrained")
    above, below = figure.subfigures(2, 1, height_ratios=(1.15, 1))
    for axes, row in zip(above.subplots(1, 4, sharey=True), shown, strict=True):
        states, weights = pictures[row]
        (columns, column), (rows, of_row) = (np.unique(values, return_inverse=True) for values in states.T)
        image = np.zeros((len(rows), len(columns)))  # the filter omits cells of negligible probability
        image[of_row, column] = np.sqrt(weights)
        low, high = states.min(axis=0) * MM, states.max(axis=0) * MM
        axes.imshow(image, origin="lower", extent=(low[0], high[0], low[1], high[1]), cmap="Blues")
        material(axes, region=False)
        axes.plot(*(sweep.truth[row] * MM), "o", color="tab:red", ms=13, mew=1.4, mfc="none")
        axes.set_title(f"palm (o) at x = {sweep.truth[row, 0] * MM:.0f} mm")
        axes.label_outer()
    x = sweep.truth[:, 0] * MM
    spread, proof = below.subplots(1, 2)
    spread.semilogy(x, [np.sqrt(estimate.trace / 2) * MM for estimate in estimates])
    spread.set_yticks((1, 2, 5, 10, 20), ("1", "2", "5", "10", "20"))
    spread.minorticks_off()
    spread.set_title("standard deviation per axis, mm")
    proof.plot(x, [estimate.on_map for estimate in estimates], label="on the map")
    proof.plot(x, [estimate.probability for estimate in estimates], label="and within the radius")
    proof.axhline(Configuration().convergence_probability, color="0.5", ls="--", lw=0.8)
    proof.set_title("probability (dashed: converged above)")
    proof.legend(frameon=False, loc="lower right")
    converged = np.array([estimate.converged for estimate in estimates])
    for axes in (spread, proof):
        axes.fill_between(
            x, 0, 1, where=converged, transform=axes.get_xaxis_transform(), color="tab:green", alpha=0.2
        )
        axes.axvline(x[sweep.contact[0]], color=FEATURE, lw=2, zorder=0)
        axes.set_xlabel("x of the palm, mm (line: contact; green: converged)")
    save(figure, "belief")


def features() -> None:
    """Sweeps over a bump and over a seam, with the map that they were localized on."""
    figure = plt.figure(figsize=(7.6, 3.7), layout="constrained")
    plots = figure.subplots(1, 2, sharey=True)
    for axes, (feature, title) in zip(
        plots, {"bump": "a bump", "seam": "a seam along y"}.items(), strict=True
    ):
        training = scan_of(simulate_recording(feature, seed=1), SCENE)
        localizer = build_localizer(training, SCENE, Configuration(), np.random.default_rng(1))
        sweeps = replay(localizer, simulate_recording(feature, seed=1, kind="test"))
        tactile_map = make_map(training, SCENE)
        signal = np.sqrt(np.mean((tactile_map.values - tactile_map.background) ** 2, axis=-1))
        x, y = (MM * nodes for nodes in tactile_map.nodes)
        axes.pcolormesh(x, y, np.ma.masked_invalid(signal.T), cmap="Greys", vmax=0.5, zorder=0)
        draw_paths(axes, sweeps)
        verdict = judge(sweeps)
        axes.set_title(
            f"{title}: {verdict.right} of {verdict.sweeps} sweeps right, {verdict.wrong} ever wrong"
        )
    plots[1].set_ylabel("")
    claims = {"not converged": SEARCHING, "converged": CONVERGED, "converged, wrong": WRONG}
    handles = [Line2D([], [], color=colour, lw=2.0, label=name) for name, colour in claims.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False)
    save(figure, "features")


def save(figure: plt.Figure, name: str) -> None:
    """Write a picture."""
    figure.savefig(IMAGES / f"{name}.png", dpi=130)
    plt.close(figure)


if __name__ == "__main__":
    plt.switch_backend("Agg")
    plt.rcParams.update({"font.size": 8.5, "axes.titlesize": 9})
    frames()
    scan()
    belief()
    features()
