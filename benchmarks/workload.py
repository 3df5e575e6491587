"""Workload of the core's benchmarks: simulated scans of the paper's size and larger, test sweeps, times."""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.resources import resource_path
from tactile_localizer.scene import Axis, Scene
from tactile_localizer.sim import simulate_scan
from tactile_localizer.sim.sweep import SIDE_M

PAIRS = 16_321
"""Number of training pairs in the paper."""
POSITION_STD = 0.0254 * np.sqrt(0.0075)
"""Square root of the paper's S_x, m."""
STRAIN_STD = np.sqrt(0.001)
"""Square root of the paper's S_z, V."""
UPDATE_M = 0.0005
PRESENT = np.ones(2, dtype=bool)
_CONVERGED_STD = 0.0012
_KINDS = 4


def bump_scene(tiles: tuple[int, int] = (1, 1)) -> Scene:
    """Scene of the simulated bump, or of several such squares side by side without a feature region."""
    scene = load_scene(resource_path("config/scenes/bump.yaml"))
    if tiles == (1, 1):
        return scene
    axes = tuple(
        Axis(axis.name, axis.lower, axis.upper + (count - 1) * SIDE_M, axis.motion_std)
        for axis, count in zip(scene.axes, tiles, strict=True)
    )
    return replace(scene, axes=axes, feature=None)


def middle(tiles: tuple[int, int]) -> np.ndarray:
    """Position of the square that the test sweeps fit, (2,) m."""
    return SIDE_M * np.array([count // 2 for count in tiles], dtype=float)


def bump_scan(tiles: tuple[int, int] = (1, 1)) -> Scan:
    """Scan with 16,321 pairs per square; squares around the middle one have other scans or signs."""
    rng = np.random.default_rng(0)
    squares = [_paper_sized(seed) for seed in range(1, min(_KINDS, tiles[0] * tiles[1]) + 1)]
    parts = []
    for number, place in enumerate(np.ndindex(*tiles)):
        shift = SIDE_M * np.array(place, dtype=float)
        own = (shift == middle(tiles)).all()
        of = squares[0] if own else squares[number % len(squares)]
        signs = 1.0 if own else rng.choice([-1.0, 1.0], of.strain.shape[1])
        parts.append(
            Scan(of.states + shift, of.strain * signs, of.sweep + 100 * number, of.axes, of.phalanges)
        )
    return Scan(
        np.concatenate([part.states for part in parts]),
        np.concatenate([part.strain for part in parts]),
        np.concatenate([part.sweep for part in parts]),
        parts[0].axes,
        parts[0].phalanges,
    )


def _paper_sized(seed: int) -> Scan:
    scan = simulate_scan("bump", seed, sweeps=22).to_scan()
    return scan.select(np.unique(np.linspace(0, len(scan) - 1, PAIRS).astype(int)))


def steps(shift: np.ndarray | float = 0.0) -> Iterator[tuple[np.ndarray | None, np.ndarray, np.ndarray]]:
    """Endless updates along the test sweeps, 0.5 mm apart.

    Parameters
    ----------
    shift : (2,) offset of the true states, m

    Yields
    ------
    displacement (2,) since the last update, ``None`` at the start of a sweep; true state (2,); strain (16,)
    """
    test = simulate_scan("bump", 1, "test")
    while True:
        for sweep in test.slices():
            last = None
            for row in range(sweep.start, sweep.stop):
                here = test.odometry[row]
                if last is None or np.hypot(*(here - last)) >= UPDATE_M:
                    yield None if last is None else here - last, test.truth[row] + shift, test.strain[row]
                    last = here


class Stopwatch:
    """Times of an operation along the test sweeps, s.

    Parameters
    ----------
    run : timed operation, called with a displacement (2,) and a strain vector (16,)
    prepare : untimed preparation, called with the true state (2,)
    every_step : whether to prepare before each update, or only at the start of a sweep
    shift : (2,) offset of the true states, m
    """

    def __init__(
        self,
        run: Callable[[np.ndarray, np.ndarray], object],
        prepare: Callable[[np.ndarray], object],
        every_step: bool,
        shift: np.ndarray | float = 0.0,
    ) -> None:
        self._run, self._prepare, self._every_step = run, prepare, every_step
        self._steps = steps(shift)
        self._warm = 0
        self.times: list[float] = []

    def step(self) -> None:
        """Time one update; the first two after the preparation for a whole sweep do not count."""
        displacement, truth, strain = next(self._steps)
        if displacement is None or self._every_step:
            self._prepare(truth)
            self._warm = 0 if self._every_step else 2
        begin = time.perf_counter()
        self._run(np.zeros(2) if displacement is None else displacement, strain)
        taken = time.perf_counter() - begin
        if self._warm:
            self._warm -= 1
        else:
            self.times.append(taken)

    @property
    def median_us(self) -> float:
        """Median time, µs."""
        return 1e6 * float(np.median(self.times))

    @property
    def p99_us(self) -> float:
        """99th percentile of the time, µs."""
        return 1e6 * float(np.quantile(self.times, 0.99))


def converged_std() -> np.ndarray:
    """Standard deviation of a converged belief, (2,) m."""
    return np.full(2, _CONVERGED_STD)


def floor_us(scan: Scan) -> float:
    """Time of one read of the training strain, the faster of two methods, µs."""
    strain = np.ascontiguousarray(scan.strain.T)
    ones = np.ones(len(strain))
    times: list[list[float]] = [[], []]
    for _ in range(200):
        for taken, read in zip(times, (strain.sum, lambda: ones @ strain), strict=True):
            begin = time.perf_counter()
            read()
            taken.append(time.perf_counter() - begin)
    return 1e6 * float(min(np.median(taken) for taken in times))


def peak_mb(build_and_run: Callable[[], object]) -> float:
    """Peak memory of Python and numpy during a call, MB."""
    tracemalloc.start()
    try:
        build_and_run()
        return tracemalloc.get_traced_memory()[1] / 1e6
    finally:
        tracemalloc.stop()


def tv_to_exact(
    scene: Scene,
    exact: Callable[[np.ndarray, np.ndarray], np.ndarray],
    found: Callable[[np.ndarray, np.ndarray], np.ndarray],
    converged: bool,
    shift: np.ndarray | float = 0.0,
    strains: int = 30,
) -> float:
    """Largest total variation distance between the weights of 75 states by two models, over some strains."""
    rng, worst = np.random.default_rng(0), 0.0
    source = steps(shift)
    for _ in range(strains):
        for _ in range(17):
            _, truth, strain = next(source)
        near = np.clip(truth + _CONVERGED_STD * rng.standard_normal((75, 2)), scene.lower, scene.upper)
        uniform = scene.lower + rng.random((75, 2)) * scene.extent
        states = near if converged else uniform
        a, b = (np.exp(v - v.max()) for v in (exact(states, strain), found(states, strain)))
        worst = max(worst, 0.5 * float(np.abs(a / a.sum() - b / b.sum()).sum()))
    return worst
