"""Replay: estimates as from the filter node, and the JSON document."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from support.sweeps import CALIBRATION

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.core.localizer import Localizer
from tactile_localizer.io.status import MISSING
from tactile_localizer.offline.json_file import write_json
from tactile_localizer.offline.odometry import travelled
from tactile_localizer.offline.replay import replay
from tactile_localizer.sim import shipped_scene, simulate_recording, simulate_scan

SCENE, SCAN = shipped_scene("bump"), simulate_scan("bump", 1)
RECORDING = simulate_recording("bump", 1, "test", sweeps=2, rate=40.0)


def localizer() -> Localizer:
    quick, rng = Configuration(filter="particle", particles=100), np.random.default_rng(1)
    return build_localizer(SCAN, SCENE, quick, rng, calibration=CALIBRATION)


def test_a_track_equals_the_localizers_estimates() -> None:
    replayed = replay(localizer(), RECORDING)
    by_hand = localizer()
    for sweep, one in zip(RECORDING.sweeps, replayed, strict=True):
        by_hand.reset()
        estimates = [
            by_hand.update(int(s), p, z)
            for s, p, z in zip(sweep.stamp_ns, sweep.position, sweep.strain, strict=True)
        ]
        np.testing.assert_array_equal(one.mean, [e.mean for e in estimates])
        np.testing.assert_array_equal(one.covariance, [e.covariance for e in estimates])
        np.testing.assert_array_equal(one.trace, [e.trace for e in estimates])
        np.testing.assert_array_equal(one.stamp_ns, sweep.stamp_ns)
        np.testing.assert_array_equal(one.travel, travelled(SCENE, sweep.truth))
        assert one.reason == tuple(e.reason for e in estimates)
        assert (one.seconds > 0).all()


def test_each_sweep_starts_from_a_uniform_prior() -> None:
    uniform = (SCENE.upper - SCENE.lower) ** 2 / 12
    fractions: list[float] = []
    for one in replay(localizer(), RECORDING, lambda text, fraction: fractions.append(fraction)):
        assert one.trace[0] > 0.5 * uniform.sum()
        assert one.trace.min() < 0.1 * uniform.sum()
        assert one.travel[0] == 0.0
    first, second = map(len, RECORDING.sweeps)
    rows = [*range(0, first, 500), *range(first, first + second, 500), first + second]
    assert fractions == [row / (first + second) for row in rows]


def test_missing_phalanges_are_left_out() -> None:
    sweep = RECORDING.sweeps[0]
    status, strain = sweep.status.copy(), sweep.strain.copy()
    status[50:90, 0] = MISSING
    strain[50:90, :8] = np.nan
    status[100:107] = MISSING
    strain[110, 3] = np.nan  # although its status is OK
    (one,) = replay(localizer(), replace(RECORDING, sweeps=(replace(sweep, status=status, strain=strain),)))
    assert one.refused == 8
    np.testing.assert_array_equal(np.setdiff1d(np.arange(len(sweep)), one.row), [*range(100, 107), 110])
    assert np.isfinite(one.mean).all()


def test_rows_are_written_as_json_can_hold_them(tmp_path: Path) -> None:
    row = {
        "stamp_ns": np.int64(2**62 + 1),
        "mean": np.array([0.1, np.nan]),
        "converged": np.True_,
        "evidence": np.inf,
        "reason": "lost: é",
    }
    write_json(tmp_path / "out.json", {"n": 2, "rows": [row, {}]})
    found = json.loads((tmp_path / "out.json").read_text())
    assert found["kind"] == "result of tactile-localizer"
    assert (found["n"], found["rows"]) == (2, [{**row, "mean": [0.1, None], "evidence": None}, {}])
