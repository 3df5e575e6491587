"""Outcome and display of live sweeps."""

import contextlib
import os
import signal
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from support.sweeps import scene_of

pytestmark = pytest.mark.ros

N = 101


def sweep(error_mm=2.0, converged_from=60, contact=(0.020, 0.040)):
    """50 mm in 1 s along y = 10 mm; the estimate is 20 mm beside it before contact, ``error_mm`` after."""
    from tactile_localizer.demo.show import LiveSweep

    x = np.linspace(0.0, 0.05, N)
    truth = np.stack([x, np.full(N, 0.01)], axis=1)
    off = np.where((x >= 0.020) & (x <= 0.040), error_mm * 1e-3, 0.020)
    mean = truth + np.stack([np.zeros(N), off], axis=1)
    return LiveSweep(np.arange(N) * 0.01, mean, truth, np.arange(N) >= converged_from, contact)


def test_errors_count_between_contact_and_feature_end():
    outcome = sweep(error_mm=1.5).outcome()
    assert outcome["error_after_contact_mm"] == pytest.approx(1.5)
    assert outcome["time_to_convergence_s"] == pytest.approx(0.6)
    assert outcome["travel_to_convergence_mm"] == pytest.approx(30.0)
    assert (outcome["converged"], outcome["converged_before_contact"]) == (True, False)
    assert sweep(converged_from=10).outcome()["converged_before_contact"]


def test_what_did_not_happen_has_no_number():
    never = sweep(converged_from=N).outcome()
    assert (never["time_to_convergence_s"], never["error_converged_mm"], never["converged"]) == (
        None,
        None,
        False,
    )
    beside = sweep(contact=None).outcome()
    assert beside["error_after_contact_mm"] is None
    assert beside["converged_before_contact"], "it converged without contact"


@pytest.mark.parametrize(("errors_mm", "within"), [((2.0, 3.0), True), ((2.0, 3.2), False), ((), False)])
def test_the_limit_applies_to_the_mean_of_the_sweeps(errors_mm, within):
    from tactile_localizer.demo.show import summarize

    summary = summarize([sweep(error) for error in errors_mm])
    assert summary["within_limit"] is within
    assert summary["converged_sweeps"] == len(errors_mm)


def test_truth_is_interpolated_at_the_stamps_of_the_sweep():
    from tactile_localizer.demo.show import Observations
    from tactile_localizer.msg import Posterior

    seen = Observations(truths=[(100, 0.0, 0.0), (200, 0.01, 0.02)])
    for stamp_ns in (50, 150, 250):
        message = Posterior(mean=[0.0, 0.0], covariance=[1.0, 0.0, 0.0, 1.0])
        message.header.stamp.nanosec = stamp_ns
        seen.add("filter/posterior", message)
    found = seen.sweep(200, None)
    np.testing.assert_allclose(found.truth, [[0.005, 0.01]])


def test_an_interrupt_lets_what_runs_finish():
    from tactile_localizer.demo.show import Watcher

    finished = []

    def interrupted():
        os.kill(os.getpid(), signal.SIGINT)
        finished.append(True)

    before = signal.getsignal(signal.SIGINT)
    with contextlib.closing(Watcher(int(os.environ["ROS_DOMAIN_ID"]))) as watcher:
        with pytest.raises(KeyboardInterrupt):
            watcher.until(interrupted, "an interrupt")
        assert finished == [True]
    assert signal.getsignal(signal.SIGINT) is before


def test_a_terminal_shows_a_map_and_others_show_lines(capsys):
    from tactile_localizer.demo.show import Observations, View, describe, material_map
    from tactile_localizer.msg import Posterior

    seen = Observations(truths=[(1, 0.020, 0.024)], particles=np.array([[0.02, 0.025, 1.0]]))
    seen.posteriors.append(Posterior(mean=[0.040, 0.024], reason="converged: so it is"))
    text = material_map(scene_of(), seen).plain
    assert "o" in text.splitlines()[8]
    assert "x" in text
    assert text.endswith("converged: so it is")
    with Path(os.devnull).open("w") as nowhere:
        console = Console(force_terminal=True, width=120, record=True, file=nowhere)
        with View(console, scene_of()) as view:
            view.show(seen)
        assert "converged: so it is" in console.export_text()
    with View(Console(), scene_of()) as view:
        for line in ("scanning", "", "scanning", describe(4, sweep(contact=None))):
            view.say(line)
        view.show(seen)
    lines = [line[9:] for line in capsys.readouterr().out.splitlines()]
    assert lines == [
        "scanning",
        "sweep  5 from ( 0.0, 10.0) mm: no contact, converged after 30.0 mm",
    ]
