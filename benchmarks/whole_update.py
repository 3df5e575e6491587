"""Time of the whole measurement update of a localizer and of its parts, timed where it calls them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial, wraps
from typing import Any

import numpy as np
from record import row
from workload import UPDATE_M, bump_scan, bump_scene

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.decision.convergence import Convergence
from tactile_localizer.core.decision.phalanx_consistency import PhalanxConsistency
from tactile_localizer.core.decision.presence import Presence
from tactile_localizer.core.decision.sweep_offset import SweepOffset
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.core.localizer import Estimate, Localizer
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Axis, Phalanx, Scene
from tactile_localizer.sim import simulate_scan, simulate_sweep

YAWS = np.radians([-10.0, -5.0, 0.0, 5.0, 10.0])
"""Scanned angles of the hand on three axes, rad."""
_TEST_YAWS = np.radians([-6.0, 0.0, 3.0, 7.0])
_LINE_M = 0.0241
_WITHIN_M = 0.01
_FALSE_MM = 10.0
_IN_95_PERCENT = 7.81
"""95 % quantile of the chi-square distribution with three degrees of freedom."""
_STEP_NS = 10_000_000
_REST = "motion, estimate and the rest"


class Parts:
    """Times of the parts of consecutive updates, s."""

    def __init__(self) -> None:
        self.updates: list[dict[str, float]] = []
        self._current: dict[str, float] | None = None
        self._running = False

    def run(self, update: Callable[[], Estimate], counts: bool) -> Estimate:
        """Run an update, and record the times of its parts if it counts."""
        self._current = {} if counts else None
        begin = time.perf_counter()
        estimate = update()
        if self._current is not None:
            self._current["whole"] = time.perf_counter() - begin
            self.updates.append(self._current)
        return estimate

    def timed(self, part: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Wrap a function so that its time is added to ``part``, unless another part is running."""

        @wraps(function)
        def call(*arguments: Any, **options: Any) -> Any:
            if self._running or self._current is None:
                return function(*arguments, **options)
            self._running = True
            begin = time.perf_counter()
            try:
                return function(*arguments, **options)
            finally:
                self._current[part] = self._current.get(part, 0.0) + time.perf_counter() - begin
                self._running = False

        return call

    def typical(self) -> dict[str, float]:
        """Mean time of each part over the middle half of the updates, s; the parts sum to the whole."""
        whole = np.array([update["whole"] for update in self.updates])
        low, high = np.quantile(whole, (0.25, 0.75))
        chosen = [u for u in self.updates if low <= u["whole"] <= high]
        names = {name: None for update in chosen for name in update}
        means = {name: float(np.mean([update.get(name, 0.0) for update in chosen])) for name in names}
        whole_s = means.pop("whole")
        return {"whole": whole_s, **means, _REST: whole_s - sum(means.values())}


@contextmanager
def parts_of(localizer: Localizer) -> Iterator[Parts]:
    """Context that times the parts of the updates of a localizer."""
    parts = Parts()
    bayes, model = type(localizer.filter), type(localizer.model)
    named = [
        ("filter: prediction", bayes, ("predict", "inject")),
        ("filter: states", bayes, ("prior",)),
        ("likelihood", model, ("whitened", "evaluate")),
        ("filter: posterior and moments", bayes, ("update", "belief", "hypotheses", "mass_near")),
        ("presence on the map", Presence, ("predict", "update")),
        ("convergence", Convergence, ("update",)),
        ("offset of the sweep", model, ("expected",)),
        ("offset of the sweep", SweepOffset, ("update", "phalanx_variance")),
        ("phalanx consistency", PhalanxConsistency, ("observe",)),
    ]
    kept = [
        (kind, name, getattr(kind, name)) for _, kind, names in named for name in names if hasattr(kind, name)
    ]
    try:
        for part, kind, names in named:
            for name in names:
                if hasattr(kind, name):
                    setattr(kind, name, parts.timed(part, getattr(kind, name)))
        yield parts
    finally:
        for kind, name, function in kept:
            setattr(kind, name, function)


def scenario(dimension: int) -> tuple[Scan, Scene, list[tuple[np.ndarray, np.ndarray]]]:
    """Scan, scene and test sweeps (positions, strains) on one, two or three axes."""
    bump = bump_scene()
    if dimension == 1:
        x = bump.axes[0]
        scene = Scene("line", (x,), tuple(replace(p, offset=p.offset[:1]) for p in bump.phalanges))
        sweeps = [simulate_sweep("bump", 1, number, "train", start=(0.0, _LINE_M)) for number in range(10)]
        scan = Scan(
            np.concatenate([sweep.odometry[:, :1] for sweep in sweeps]),
            np.concatenate([sweep.strain for sweep in sweeps]),
            np.repeat(np.arange(10), [len(sweep.strain) for sweep in sweeps]),
            ("x",),
            scene.phalanx_names,
        )
        test = [simulate_sweep("bump", 1, number, "test", start=(0.004, _LINE_M)) for number in range(8)]
        return scan, scene, [(sweep.odometry[:, :1], sweep.strain) for sweep in test]
    if dimension == 2:
        test_scan = simulate_scan("bump", 1, "test")
        return bump_scan(), bump, [(test_scan.odometry[s], test_scan.strain[s]) for s in test_scan.slices()]
    scene = Scene(
        "turned",
        (*bump.axes, Axis("yaw", float(YAWS[0]), float(YAWS[-1]), 0.05)),
        tuple(Phalanx(p.name, (*p.offset, 0.0)) for p in bump.phalanges),
    )
    # One seed per session; with a common seed all sessions would have the same noise.
    sessions = [simulate_scan("bump", 1 + number, yaw=float(yaw)) for number, yaw in enumerate(YAWS)]
    scan = Scan(
        np.concatenate([_with_yaw(s.odometry, yaw) for s, yaw in zip(sessions, YAWS, strict=True)]),
        np.concatenate([session.strain for session in sessions]),
        np.concatenate([session.sweep + 100 * number for number, session in enumerate(sessions)]),
        ("x", "y", "yaw"),
        scene.phalanx_names,
    )
    turned = simulate_scan("bump", 1, "test", yaw=0.05)
    return scan, scene, [(_with_yaw(turned.odometry[s], 0.05), turned.strain[s]) for s in turned.slices()]


def _with_yaw(positions: np.ndarray, yaw: float) -> np.ndarray:
    return np.column_stack([positions, np.full(len(positions), yaw)])


def measured(
    title: str,
    localizer: Localizer,
    sweeps: list[tuple[np.ndarray, np.ndarray]],
    converged: bool,
    limit_us: float | None,
    updates: int = 300,
) -> list[dict[str, Any]]:
    """Rows of the whole update and its parts, converged or in the second update after a reset.

    There are no rows if no sweep converges.
    """
    with parts_of(localizer) as parts:
        for positions, strains in sweeps:
            if len(parts.updates) < updates:
                _along(localizer, parts, positions, strains, converged)
        if not parts.updates:  # no sweep converges
            return []
        whole = 1e6 * np.array([update["whole"] for update in parts.updates])
        typical = parts.typical()
    limit = None if limit_us is None else f"<= {limit_us:g}"
    rows = [
        row(
            f"{title}: whole update",
            float(np.median(whole)),
            "us",
            limit,
            p99_us=float(np.quantile(whole, 0.99)),
        )
    ]
    sum_us = 1e6 * typical.pop("whole")
    rows += [
        row(f"{title}: - {part}", 1e6 * seconds, "us")
        for part, seconds in sorted(typical.items(), key=lambda item: -item[1])
    ]
    return [*rows, row(f"{title}: = sum of the parts", sum_us, "us")]


def _along(
    localizer: Localizer, parts: Parts, positions: np.ndarray, strains: np.ndarray, converged: bool
) -> None:
    """Update every 0.5 mm along a sweep; for a spread belief, reset before every second update."""
    localizer.reset()
    rows = [0]
    for number, position in enumerate(positions):
        if np.linalg.norm((position - positions[rows[-1]])[:2]) >= UPDATE_M:
            rows.append(number)
    estimate: Estimate | None = None
    for number, at in enumerate(rows):
        if not converged and number % 2 == 0:
            localizer.reset()
        counts = estimate is not None and estimate.converged if converged else number % 2 == 1
        update = partial(localizer.update, number * _STEP_NS, positions[at], strains[at])
        estimate = parts.run(update, counts)


def turned_sweeps(localizer: Localizer) -> list[dict[str, Any]]:
    """Rows of convergence and errors of sweeps at angles between the scanned ones."""
    within, errors, turns, false, covered = [], [], [], [], []
    for yaw in _TEST_YAWS:
        test = simulate_scan("bump", 1, "test", yaw=float(yaw), sweeps=9)
        palms = _with_yaw(test.odometry, yaw)
        for rows, contact, end in zip(test.slices(), test.contact, test.feature_end, strict=True):
            localizer.reset()
            converged_at = np.inf
            for sample in range(rows.start, end + 1):
                estimate = localizer.update(int(test.stamp_ns[sample]), palms[sample], test.strain[sample])
                error = 1e3 * float(np.linalg.norm(estimate.mean[:2] - test.truth[sample]))
                false.append(estimate.converged and (sample < contact or error > _FALSE_MM))
                if estimate.converged:
                    converged_at = min(converged_at, test.truth[sample, 0] - test.truth[contact, 0])
                if sample >= contact:
                    errors.append(error)
                    off = estimate.mean - (*test.truth[sample], yaw)
                    turns.append(abs(np.degrees(off[2])))
                    covered.append(off @ np.linalg.solve(estimate.covariance, off) <= _IN_95_PERCENT)
            within.append(converged_at <= _WITHIN_M)
    return [
        row("3 axes: sweeps that converge within 10 mm of contact", np.mean(within), "fraction", ">= 0.95"),
        row("3 axes: falsely converged samples", np.mean(false), "fraction"),
        row("3 axes: error from contact to the feature's end", np.mean(errors), "mm"),
        row("3 axes: error of the yaw there", np.mean(turns), "deg"),
        row("3 axes: coverage of the 95 % region there", np.mean(covered), "fraction"),
    ]


def whole_updates() -> list[dict[str, Any]]:
    """Updates of the default configuration on one to three axes, converged and spread."""
    rows = []
    for dimension, limits in ((1, (250.0, None)), (2, (250.0, 400.0)), (3, (10_000.0, 10_000.0))):
        scan, scene, sweeps = scenario(dimension)
        begin = time.perf_counter()
        localizer = build_localizer(scan, scene, Configuration(), np.random.default_rng(0))
        axes = "1 axis" if dimension == 1 else f"{dimension} axes"
        rows.append(row(f"{axes}: from the scan to a localizer", time.perf_counter() - begin, "s"))
        rows += measured(f"{axes}, converged", localizer, sweeps, True, limits[0])
        rows += measured(f"{axes}, spread", localizer, sweeps, False, limits[1])
        if dimension == 3:
            rows += turned_sweeps(localizer)
    return rows
