"""Draws docs/images/essentials.png: the effect of wrong scene parameters on the simulated bump."""

from __future__ import annotations

import sys
from collections.abc import Callable
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
from tactile_localizer.sim.scan import TRAINING_SWEEPS, simulate_scan

PICTURE = Path(__file__).parents[1] / "images/essentials.png"
SWEEPS = 6
MM = 1e3
WRONG_MM = 10.0
"""Error above which convergence is false, m."""


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
    "bounds": "bounds farther out than needed, mm",
    "passes": "sweeps along each line of the scan",
    "motion_std": "motion_std, times that of the scene;\nthe arm reports 15 % too much travel",
    "convergence_radius": "convergence_radius, mm",
    "lines": "distance of the scanned lines, mm",
}
SLIP = 1.15
"""Travel reported by the arm relative to that of the palm, in the trials of motion_std."""


def trial(task: tuple[str, float]) -> tuple[float, float, float]:
    """Median error after contact, mm; fractions converged there, and converged with over 10 mm of error."""
    name, value = task
    scene = load_scene(resource_path("config/scenes/bump.yaml"))
    change: dict[str, Callable[[Scene, float], Scene]] = {
        "bounds": with_margin, "motion_std": with_motion,
    }  # fmt: skip
    if name in change:
        scene = change[name](scene, value)
    passes = int(value) if name == "passes" else 1
    train = simulate_scan("bump", 1, "train", sweeps=passes * TRAINING_SWEEPS).to_scan()
    inside = screen(scene, train.states, train.strain, np.zeros((len(train), 2), np.uint8)) == USABLE
    if name == "lines":
        inside &= train.sweep % round(value / 2.54) == 0
    choices = Configuration()
    if name == "convergence_radius":
        choices = replace(choices, convergence_radius=value / MM)
    localizer = make_localizer(train.select(inside), scene, choices, seed=1)
    test = simulate_scan("bump", 1, "test", sweeps=SWEEPS)
    position = (SLIP if name == "motion_std" else 1.0) * test.odometry
    errors, converged = [], []
    for part, contact in zip(test.slices(), test.contact, strict=True):
        localizer.reset()
        for k in range(part.start, part.stop):
            estimate = localizer.update(int(test.stamp_ns[k]), position[k], test.strain[k])
            if k > contact >= 0:
                errors.append(float(np.linalg.norm(estimate.mean - test.truth[k])) * MM)
                converged.append(estimate.converged)
    error, sure = np.array(errors), np.array(converged)
    return float(np.median(error)), float(sure.mean()), float((sure & (error > WRONG_MM)).mean())


def main() -> None:
    """Run all trials and draw."""
    tasks = [(name, value) for name, values in VALUES.items() for value in values]
    with ProcessPoolExecutor(2) as pool:
        found = dict(zip(tasks, pool.map(trial, tasks), strict=True))
    for task, numbers in found.items():
        print(*task, *(f"{number:.3g}" for number in numbers), file=sys.stderr)
    figure = Figure(figsize=(15, 3.6), layout="constrained")
    for plot, (name, values) in zip(figure.subplots(1, len(VALUES)), VALUES.items(), strict=True):
        error, sure, wrong = np.array([found[name, value] for value in values]).T
        lines = plot.plot(values, error, "ko-", label="median error after contact, mm")
        share = plot.twinx()
        lines += share.plot(values, 100 * sure, "o--", color="tab:blue", label="converged, %")
        lines += share.plot(
            values, 100 * wrong, "s--", color="tab:red", label="converged and over 10 mm wrong, %"
        )
        share.set_ylim(-4, 104)
        share.tick_params(axis="y", colors="0.4", labelright=name == "lines")
        plot.set_ylim(0, 5)
        plot.tick_params(axis="y", labelleft=name == "bounds")
        plot.set_xlabel(LABELS[name])
        plot.set_title(name)
        if name == "motion_std":
            plot.set_xscale("log")
        if name == "passes":
            plot.set_xticks(values)
    figure.legend(lines, [str(line.get_label()) for line in lines], loc="outside lower center", ncols=3)
    figure.savefig(PICTURE, dpi=110)


if __name__ == "__main__":
    main()
