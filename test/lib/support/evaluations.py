"""A quick condition and synthetic results, for tests of evaluations."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from evaluation.comparison import Method, Results
from evaluation.conditions import (
    RecordedCondition,
    SimulatedCondition,
    recording_of,
)
from evaluation.methods import PAPER_PARAMETERS, standard_methods

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.resources import resource_path
from tactile_localizer.sim import simulate_scan

TUNED = {"position_std": 0.003, "strain_std": 0.03, "correlation_length": 0.003}

CALIBRATION = {"information_length": 0.0022, "registration_std": [0.0004, 0.0004], "variance": None}

QUICK = (
    Method("default", Configuration(filter="particle", particles=60)),
    Method(
        "other",
        Configuration(model="sum_of_gaussians", filter="particle", particles=20),
        dict(PAPER_PARAMETERS),
    ),
)


@cache
def condition(seed: int = 1, sweeps: int = 2) -> RecordedCondition:
    """Sparse test sweeps over the simulated bump, on a sparse scan."""
    scene = replace(load_scene(resource_path("config/scenes/bump.yaml")), measurement=TUNED)
    scan = simulate_scan("bump", 1, rate=20.0).to_scan()
    recording = recording_of(simulate_scan("bump", 1, "test", sweeps=sweeps, rate=20.0))
    return RecordedCondition("bump", seed, scan, scene, recording)


_STRETCHES = 12
_SWEEP = {
    "number": 0,
    "contact_m": [0.02, 0.04],
    "error_m": 0.008,
    "error_contact_m": 0.002,
    "error_before_m": 0.015,
    "final_error_m": 0.002,
    "trace_before_m2": 2e-4,
    "coverage": 0.95,
    "coverage_contact": 0.94,
    "nees": 1.1,
    "nees_contact": 1.2,
    "converged_before": False,
    "converged": True,
    "travel_to_convergence_m": 0.002,
    "time_to_convergence_s": 0.3,
    "error_converged_m": 0.0015,
    "lowest_trace_before_m2": 1e-4,
    "highest_marginal_before": 40.0,
    "lowest_trace_contact_m2": 1e-6,
    "highest_marginal_contact": 42.0,
    "error_curve_m": [0.01] * 50,
    "trace_curve_m2": [1e-4] * 50,
    "error_after_contact_m": [0.004, 0.002] + [0.0015] * (_STRETCHES - 2),
    "error_past_m": [0.002] * 6 + [None] * (_STRETCHES - 6),
    "motion_past_m": [0.0025] * 6 + [None] * (_STRETCHES - 6),
    "error_after_travel_m": {"0.01": 0.006, "0.04": 0.002},
}
_BLANK = {"converged": False, "lowest_trace_blank_m2": 1e-4, "highest_marginal_blank": 30.0}


def results(
    changed: dict[str, dict[str, object]] | None = None,
    blanks: dict[str, dict[str, object]] | None = None,
    sweeps: int = 12,
) -> Results:
    """Results of all standard methods on two conditions, made up; by method, what differs from the usual."""
    conditions = tuple(SimulatedCondition(name, 1) for name in ("bump", "snap"))
    methods = standard_methods()
    tasks = {}
    for name in methods:
        own = [_vary(_SWEEP | (changed or {}).get(name, {}), n, sweeps) for n in range(sweeps)]
        blank = [_BLANK | (blanks or {}).get(name, {})] * 3
        timing = {
            "update_median_us": 300.0,
            "update_p99_us": 500.0,
            "strain_mean_us": 40.0,
            "us_per_mm": 600.0,
        }
        edges = [0.001 * n for n in range(51)]
        task = {"axis": "x", "edges_m": edges, "sweeps": own, "blanks": blank, "timing": timing}
        tasks[name] = [task | {"narrow_trace_m2": 3.2e-5}] * 2
    return Results(conditions, methods, tasks)


def _vary(sweep: dict[str, object], n: int, count: int) -> dict[str, object]:
    """Vary a result slightly between sweeps, equally for all methods, so that intervals have a width."""
    factor = 1.0 + 0.1 * (n / (count - 1) - 0.5)
    lengths = {
        name: value * factor
        for name, value in sweep.items()
        if name.endswith("_m") and isinstance(value, float)
    }
    return sweep | lengths | {"number": n}
