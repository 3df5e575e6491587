"""Draws docs/images/essentials.png: the effect of wrong values on the simulated bump.

``scripts/in_env python docs/make/essentials.py PROCESSES`` prints the numbers, too.
"""

import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from tactile_localizer import Configuration, make_localizer
from tactile_localizer.io.recording import USABLE, screen
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.resources import resource_path
from tactile_localizer.scene import Scene
from tactile_localizer.sim.scan import TRAINING_SWEEPS, simulate_recording, simulate_scan

PICTURE = Path(__file__).parents[1] / "images/essentials.png"
SEEDS = 1, 2, 3
"""Seeds of the test sessions, of 18 sweeps each."""
MM = 1e3
WRONG_MM = 10.0
"""Error above which convergence is false, mm."""
SHOWN = "error", "converged", "converged and over 10 mm wrong"


def with_margin(scene: Scene, margin_mm: float) -> Scene:
    """The scene with its bounds moved outwards; inwards if negative."""
    move = margin_mm / MM
    axes = tuple(replace(axis, lower=axis.lower - move, upper=axis.upper + move) for axis in scene.axes)
    return replace(scene, axes=axes)


def with_motion(scene: Scene, factor: float) -> Scene:
    """The scene with another motion noise."""
    axes = tuple(replace(axis, motion_std=factor * axis.motion_std) for axis in scene.axes)
    return replace(scene, axes=axes)


VALUES = {
    "bounds": [-8, -4, 0, 10, 40],
    "passes": [1, 2, 3],
    "motion_std": [0.1, 1, 3, 10, 30],
    "convergence_radius": [2.5, 5, 7.5, 15, 30],
    "lines": [2.54, 5.08, 7.62, 12.7],
}
LABELS = {
    "bounds": "bounds farther out\nthan needed, mm",
    "passes": "sweeps along each\nline of the scan",
    "motion_std": "motion_std, times the\nscene's; the arm reports\n15 % too much travel",
    "convergence_radius": "convergence_radius,\nmm",
    "lines": "distance of the\nscanned lines, mm",
}
SLIP = 1.15
"""Travel reported by the arm relative to that of the palm, in the trials of motion_std."""


def trial(task: tuple[str, float]) -> np.ndarray:
    """Outcome (3, S) of each sweep that touches the bump, from contact on.

    Mean error, mm; percentages of the strains that are converged, and converged with over 10 mm of error.
    """
    name, value = task
    scene = load_scene(resource_path("config/scenes/bump.yaml"))
    if name == "bounds":
        scene = with_margin(scene, value)
    if name == "motion_std":
        scene = with_motion(scene, value)
    passes = int(value) if name == "passes" else 1
    train = simulate_scan("bump", 1, sweeps=passes * TRAINING_SWEEPS)
    inside = screen(scene, train.states, train.strain, np.zeros((len(train), 2), np.uint8)) == USABLE
    if name == "lines":
        inside &= train.sweep % round(value / 2.54) == 0
    radius = value / MM if name == "convergence_radius" else Configuration().convergence_radius
    localizer = make_localizer(train.select(inside), scene, Configuration(convergence_radius=radius), seed=1)
    found = []
    for test in (simulate_recording("bump", seed, "test") for seed in SEEDS):
        for sweep in test.sweeps:
            contact = sweep.contact[0]
            if contact < 0:
                continue
            localizer.reset()
            position = (SLIP if name == "motion_std" else 1.0) * sweep.position
            samples = zip(sweep.stamp_ns.tolist(), position, sweep.strain, strict=True)
            estimates = [localizer.update(*sample) for sample in samples][contact:]
            means = np.array([estimate.mean for estimate in estimates])
            error = MM * np.linalg.norm(means - sweep.truth[contact:], axis=1)
            converged = np.array([estimate.converged for estimate in estimates])
            found.append(
                (error.mean(), 100 * converged.mean(), 100 * (converged & (error > WRONG_MM)).mean())
            )
    return np.array(found).T


def main() -> None:
    """Run all trials, print their means with standard errors, and draw."""
    tasks = [(name, value) for name, values in VALUES.items() for value in values]
    with ProcessPoolExecutor(int(sys.argv[1]) if len(sys.argv) > 1 else 2) as pool:
        outcomes = dict(zip(tasks, pool.map(trial, tasks), strict=True))
    found = {}
    for task, outcome in outcomes.items():
        found[task] = outcome.mean(axis=1), outcome.std(axis=1, ddof=1) / np.sqrt(outcome.shape[1])
        print(*task, *(f"{mean:.2f} +- {error:.2f}" for mean, error in zip(*found[task], strict=True)))
    figure = Figure(figsize=(10, 4.6), layout="constrained")
    panels = figure.subplots(2, len(VALUES), sharex="col", sharey="row")
    for (above, below), (name, values) in zip(panels.T, VALUES.items(), strict=True):
        mean, error = (np.array(rows) for rows in zip(*(found[name, value] for value in values), strict=True))
        for plot, column, style in ((above, 0, "ko-"), (below, 1, "bo-"), (below, 2, "rs--")):
            plot.errorbar(values, mean[:, column], 2 * error[:, column], fmt=style, label=SHOWN[column])
        above.set_title(name)
        above.set_ylim(bottom=0)
        below.set_ylim(-4, 104)
        below.set_xlabel(LABELS[name])
        if name == "motion_std":
            below.set_xscale("log")
        if name == "passes":
            below.set_xticks(values)
    panels[0, 0].set_ylabel("error, mm")
    panels[1, 0].set_ylabel("strains, %")
    handles, labels = panels[1, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False)
    figure.savefig(PICTURE, dpi=110)


if __name__ == "__main__":
    main()
