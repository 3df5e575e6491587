"""Speed and accuracy of the core: whole update and its parts, kernel updates, maps, models, axes.

In one thread. Each time has its ratio to the floor (one read of the training strain, measured in the same
run) and the total variation distance of the weights from those of the exact sum.

Run by ``make bench``, or alone: ``scripts/in_env python benchmarks/core.py [--only updates maps ...]``.
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import argparse
import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from record import record, row
from whole_update import whole_updates
from workload import (
    PAIRS,
    POSITION_STD,
    PRESENT,
    STRAIN_STD,
    Stopwatch,
    bump_scan,
    bump_scene,
    converged_std,
    floor_us,
    middle,
    peak_mb,
)

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer, learn
from tactile_localizer.core.filters.base import BayesFilter
from tactile_localizer.core.filters.grid import GridFilter
from tactile_localizer.core.filters.particle import ParticleFilter
from tactile_localizer.core.likelihood.base import MeasurementModel
from tactile_localizer.core.likelihood.featureless import Featureless
from tactile_localizer.core.likelihood.gaussian import Gaussian
from tactile_localizer.core.likelihood.sum_of_gaussians import SumOfGaussians
from tactile_localizer.core.likelihood.weights import normalize
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.io.scans.store import ScanStore
from tactile_localizer.scene import Axis, Phalanx, Scene

TILES = {PAIRS: (1, 1), 10 * PAIRS: (5, 2), 100 * PAIRS: (10, 10)}
"""Numbers of squares side by side along x and y, by number of pairs."""
PHASES = {False: "spread", True: "converged"}


def measured(
    name: str,
    scan: Scan,
    scene: Scene,
    build: Callable[[], MeasurementModel],
    particles: int,
    converged: bool,
    *,
    updates: int = 300,
    limit: str | None = None,
    shift: np.ndarray | float = 0.0,
    floor: float | None = None,
) -> dict[str, Any]:
    """Row of an update that resamples, predicts and weights the particles, spread or converged."""

    def stopwatch(model: MeasurementModel) -> Stopwatch:
        own = ParticleFilter(scene, np.random.default_rng(0), particles, resample_below=1.0)

        def run(displacement: np.ndarray, strain: np.ndarray) -> None:
            own.predict(displacement, float(np.hypot(*displacement)))
            weight(own, model, strain, PRESENT)

        if converged:
            return Stopwatch(run, lambda truth: own.seed(truth, converged_std()), False, shift)
        return Stopwatch(run, lambda _: own.reset(), True, shift)

    model = build()
    watch = stopwatch(model)
    for _ in range(5):
        watch.step()
    watch.times.clear()
    while len(watch.times) < updates:
        watch.step()
    return row(
        name,
        watch.median_us,
        "us",
        limit,
        particles=particles,
        pairs=len(scan),
        median_us=watch.median_us,
        mean_us=1e6 * float(np.mean(watch.times)),
        p99_us=watch.p99_us,
        peak_mb=peak_mb(lambda: stopwatch(build()).step()),
        ratio_to_floor=watch.median_us / (floor or floor_us(scan)),
    )


def weight(own: BayesFilter, model: MeasurementModel, strain: np.ndarray, present: np.ndarray) -> None:
    """Update a filter with a strain vector."""
    states, _ = own.prior()
    own.update(model.log_likelihood(states, strain, present))


def sum_of_gaussians(scan: Scan, scene: Scene) -> SumOfGaussians:
    """Sum of Gaussians with the paper's widths."""
    return SumOfGaussians(scan, scene, POSITION_STD, STRAIN_STD)


def updates() -> list[dict[str, Any]]:
    """Updates on a scan of the paper's size, by particles and convergence."""
    scan, scene = bump_scan(), bump_scene()
    floor = floor_us(scan)
    rows = [row("floor: one read of the training strains", floor, "us", pairs=len(scan))]
    for particles in (75, 1_000, 10_000):
        for converged in (False, True):
            rows.append(
                measured(
                    f"update: {particles} particles, {PHASES[converged]}",
                    scan,
                    scene,
                    lambda: sum_of_gaussians(scan, scene),
                    particles,
                    converged,
                    updates=300 if particles < 10_000 else 100,
                    limit="<= 300" if particles == 75 and converged else None,
                    floor=floor,
                )
            )
    return rows


def maps() -> list[dict[str, Any]]:
    """Updates on ten and a hundred times the area, spread and converged; loading and memory."""
    rows = []
    for pairs, tiles in TILES.items():
        scan, scene = bump_scan(tiles), bump_scene(tiles)
        floor = floor_us(scan)
        for converged in (False, True):
            rows.append(
                measured(
                    f"map of {pairs:,} pairs, {PHASES[converged]}",
                    scan,
                    scene,
                    lambda scan=scan, scene=scene: sum_of_gaussians(scan, scene),
                    75,
                    converged,
                    updates=300 if converged or pairs == PAIRS else 30,
                    shift=middle(tiles),
                    floor=floor,
                )
            )
    small, large = rows[1]["median_us"], rows[3]["median_us"]
    rows.append(row("map: converged, cost of ten times the area", large / small, "x", "<= 1.5"))
    return rows + load()


def load() -> list[dict[str, Any]]:
    """Loading of a scan file of 1.6 million pairs and first update, in a separate process."""
    tiles = TILES[100 * PAIRS]
    scan, scene = bump_scan(tiles), bump_scene(tiles)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "large.db"
        with ScanStore.create(path, scene) as store:
            for number in np.unique(scan.sweep):
                own = scan.sweep == number
                store.begin_sweep()
                store.append(np.arange(np.count_nonzero(own)) * 5_000_000, scan.states[own], scan.strain[own])
                store.end_sweep()
        command = [sys.executable, Path(__file__).with_name("load_map.py"), path]
        loaded_s, first_s, before_mb, loaded_mb, first_mb = map(
            float, subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()
        )
    pairs = len(scan)
    return [
        row("map of 1.6 million pairs: load", loaded_s, "s", "<= 3", pairs=pairs, python_mb=before_mb),
        row("map of 1.6 million pairs: memory after loading", loaded_mb, "MB", "<= 600", pairs=pairs),
        row("map of 1.6 million pairs: first update, spread", first_s, "s", pairs=pairs),
        row("map of 1.6 million pairs: memory, first update", first_mb, "MB", "<= 600", pairs=pairs),
    ]


def models() -> list[dict[str, Any]]:
    """The four models, the two filters and the whole localizer, on a scan of the paper's size."""
    scan, scene = bump_scan(), bump_scene()
    floor = floor_us(scan)
    build: dict[str, Callable[[], MeasurementModel]] = {
        "sum_of_gaussians": lambda: sum_of_gaussians(scan, scene),
        "featureless": lambda: Featureless(scan, scene, POSITION_STD, STRAIN_STD),
        "gaussian": lambda: Gaussian(scan, scene),
        "gaussian_independent": lambda: Gaussian(scan, scene, independent=True),
    }
    rows = []
    for converged in (False, True):
        for name, make in build.items():
            title = f"model: {name}, 75 particles, {PHASES[converged]}"
            rows.append(measured(title, scan, scene, make, 75, converged, floor=floor))
    for name in ("gaussian", "gaussian_independent"):
        ratio = max(
            _median(rows, f"model: {name}, 75 particles, {phase}")
            / _median(rows, f"model: sum_of_gaussians, 75 particles, {phase}")
            for phase in ("spread", "converged")
        )
        rows.append(row(f"model: {name}, cost relative to sum_of_gaussians", ratio, "x", "<= 10"))
    return rows + filters(scan, scene, floor)


def _median(rows: list[dict[str, Any]], name: str) -> float:
    return next(one["median_us"] for one in rows if one["name"] == name)


def filters(scan: Scan, scene: Scene, floor: float) -> list[dict[str, Any]]:
    """Updates of the kernel model's grid filter, and of the whole localizer with both filters."""
    model = sum_of_gaussians(scan, scene)
    grid = GridFilter(scene, 0.3 * np.full(2, POSITION_STD))

    def update_grid(displacement: np.ndarray, strain: np.ndarray) -> None:
        grid.predict(displacement, float(np.hypot(*displacement)))
        weight(grid, model, strain, PRESENT)

    given = {"position_std": float(POSITION_STD), "strain_std": float(STRAIN_STD)}
    runs = {"sum_of_gaussians, grid filter": (update_grid, lambda _: grid.reset())}
    calibration = learn(scan, scene)
    for name, kind in (
        ("sweep_mixture", "grid"),
        ("sweep_mixture", "particle"),
        ("sum_of_gaussians", "grid"),
    ):
        localizer = build_localizer(
            scan,
            replace(scene, measurement=given),
            Configuration(model=name, filter=kind),
            np.random.default_rng(0),
            calibration=calibration,
        )
        place, stamp = np.zeros(2), [0]

        def update(
            displacement: np.ndarray,
            strain: np.ndarray,
            localizer: Any = localizer,
            place: Any = place,
            stamp: Any = stamp,
        ) -> None:
            place += displacement
            stamp[0] += 10_000_000
            localizer.update(stamp[0], place, strain)

        runs[f"localizer, {name}, {kind} filter"] = (update, lambda _, localizer=localizer: localizer.reset())
    rows = []
    for name, (run, prepare) in runs.items():
        watch = Stopwatch(run, prepare, every_step=False)
        while len(watch.times) < 300:
            watch.step()
        rows.append(
            row(
                f"{name}: one measurement update",
                watch.median_us,
                "us",
                pairs=len(scan),
                median_us=watch.median_us,
                p99_us=watch.p99_us,
                ratio_to_floor=watch.median_us / floor,
            )
        )
    return rows


def scenes() -> list[dict[str, Any]]:
    """Updates by number of axes and phalanges: axes and phalanges that a scene omits cost nothing."""
    scan = bump_scan()
    rng = np.random.default_rng(0)
    names = ("index", "middle", "ring", "little", "thumb")
    every = Scan(
        np.column_stack([scan.states, rng.uniform(-0.3, 0.3, len(scan))]),
        np.concatenate([scan.strain, scan.strain * rng.choice([-1, 1], 16), scan.strain[:, :8]], axis=1),
        scan.sweep,
        ("x", "y", "yaw"),
        names,
    )
    axes = (*bump_scene().axes, Axis("yaw", -0.3, 0.3, 0.05))
    widths = np.array([POSITION_STD, POSITION_STD, 0.06])
    rows = []
    for dimension, phalanges in ((1, 2), (2, 1), (2, 2), (2, 5), (3, 2)):
        fingers = tuple(Phalanx(name, (0.0,) * dimension) for name in names[:phalanges])
        scene = Scene("part", axes[:dimension], fingers)
        options = {"position_std": widths[:dimension], "strain_std": STRAIN_STD}
        name = f"scene: {dimension} axes, {phalanges} phalanges".replace("1 axes", "1 axis").replace(
            "1 phalanges", "1 phalanx"
        )
        rows.append(_scene_row(name, every, scene, options, phalanges))
    return rows


def _scene_row(
    name: str, scan: Scan, scene: Scene, options: dict[str, Any], phalanges: int
) -> dict[str, Any]:
    rng, dimension = np.random.default_rng(0), scene.dimension
    strains = scan.strain[:, : 8 * phalanges]
    present = np.ones(phalanges, dtype=bool)

    def build() -> ParticleFilter:
        return ParticleFilter(scene, np.random.default_rng(0), 75, resample_below=1.0)

    model = SumOfGaussians(scan, scene, **options)
    particles = build()
    times = []
    for number in range(205):
        particles.reset()
        strain = strains[rng.integers(len(strains))] + 0.01
        begin = time.perf_counter()
        particles.predict(np.full(dimension, 0.0003), 0.0005)
        weight(particles, model, strain, present)
        if number >= 5:
            times.append(time.perf_counter() - begin)
    median = 1e6 * float(np.median(times))
    part = replace(scan, strain=strains, phalanges=scan.phalanges[:phalanges])
    return row(
        name,
        median,
        "us",
        particles=75,
        pairs=len(scan),
        median_us=median,
        p99_us=1e6 * float(np.quantile(times, 0.99)),
        peak_mb=peak_mb(lambda: weight(build(), SumOfGaussians(scan, scene, **options), strains[0], present)),
        ratio_to_floor=median / floor_us(part),
    )


def drift() -> list[dict[str, Any]]:
    """Largest deviation of the sum of weights from one over ten million updates."""
    likelihoods = 3.0 * np.random.default_rng(0).standard_normal((1000, 8))
    log_weights, worst = np.full(8, -math.log(8)), 0.0
    for update in range(10_000_000):
        log_weights, _ = normalize(0.99 * log_weights + likelihoods[update % 1000])
        if update % 1000 == 0:
            worst = max(worst, abs(float(np.exp(log_weights).sum()) - 1.0))
    return [row("10 million updates: error of the sum of weights", worst, "", "<= 1e-12")]


GROUPS = {
    "whole": whole_updates,
    "updates": updates,
    "maps": maps,
    "models": models,
    "scenes": scenes,
    "drift": drift,
}


def main() -> None:
    """Measure and record."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="+", choices=tuple(GROUPS), default=tuple(GROUPS))
    for group in parser.parse_args().only:
        record(GROUPS[group]())


if __name__ == "__main__":
    main()
