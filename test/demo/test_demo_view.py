"""The view of the demo, with and without a terminal."""

import os
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from support.sweeps import scene_of

pytestmark = pytest.mark.ros


def midway():
    """Observations in the middle of a sweep: the truth at (20, 24) mm, the estimate 1 mm beside it."""
    from tactile_localizer.demo.observations import Observations
    from tactile_localizer.msg import Posterior

    observations = Observations()
    observations.truths = [(k, 0.001 * k, 0.024) for k in range(21)]
    for k in range(21):
        posterior = Posterior(
            mean=[0.001 * k, 0.025],
            covariance=[4e-6, 0.0, 0.0, 1e-6],
            covariance_trace=5e-6,
            converged=k > 10,
            reason="converged: so it is",
        )
        posterior.header.stamp.nanosec = k
        observations.posteriors.append(posterior)
    observations.particles = np.array([[0.02, 0.025, 0.6], [0.021, 0.026, 0.4]])
    observations.diagnostics["driver: index"] = {"drops": "3"}
    observations.diagnostics["filter: belief"] = {"update_median_us": "800.0", "update_p99_us": "1200.0"}
    return observations


def terminal():
    return Console(force_terminal=True, width=120, height=40, record=True, file=Path(os.devnull).open("w"))


def test_the_live_view_shows_all_numbers():
    from tactile_localizer.demo.view import LiveView, demo_view

    console = terminal()
    with demo_view(console, scene_of(), "bump") as view:
        assert isinstance(view, LiveView)
        view.phase("localizing")
        view.progress(3, 18)
        view.show(midway(), {"strain": 0, "palm_pose": 0, "filter/posterior": 0}, "")
    text = console.export_text()
    for shown in (
        "localizing 3 of 18 sweeps",
        "x  20.00 mm   y  24.00 mm",
        "x  20.00 mm   y  25.00 mm",
        "1.00 mm   0.039 inch",
        "5.00 mm²  (2.00 and 1.00 mm)",
        "converged: so it is",
        "strain 0/s",
        "median 800.0 µs",
        "3 frames",
    ):
        assert shown in text, shown
    assert "o" in text.split("material")[1]
    assert "x" in text.split("material")[1]


def test_the_live_view_works_without_observations():
    from tactile_localizer.demo.observations import Observations
    from tactile_localizer.demo.view import demo_view

    console = terminal()
    with demo_view(console, scene_of(), "bump") as view:
        view.phase("starting")
        view.show(Observations(), {"strain": 0, "palm_pose": 0, "filter/posterior": 0}, "")
    assert "starting" in console.export_text()


def test_without_a_terminal_events_are_lines(capsys):
    from tactile_localizer.demo.view import PlainView, demo_view

    with demo_view(Console(), scene_of(), "bump") as view:
        assert isinstance(view, PlainView)
        view.phase("scanning")
        for done in range(15):
            view.progress(done, 21)
        view.show(midway(), {}, "choosing parameters: 40%")
        view.show(midway(), {}, "choosing parameters: 40%")
        view.sweep(midway().localized_sweep(4, 20, None))
    out = capsys.readouterr().out.splitlines()
    assert [line[9:] for line in out[1:]] == [
        "scanning",
        "7 of 21 sweeps",
        "14 of 21 sweeps",
        "choosing parameters: 40%",
        "sweep  5 from ( 0.0, 24.0) mm: no contact, converged after 11.0 mm",
    ]
    assert "\x1b" not in "".join(out)
