"""Outcome of a live sweep."""

import numpy as np
import pytest

from tactile_localizer.demo.figures import error_along_the_sweep
from tactile_localizer.demo.live_sweep import Contact, LiveSweep, contact_of, summarize
from tactile_localizer.sim import simulate_scan
from tactile_localizer.sim.sweep import RATE_HZ, SPEED_MPS

N = 101


def sweep(error_mm=2.0, converged_from=60, contact=Contact(0.020, 0.040), number=0):  # noqa: B008
    """50 mm in 1 s along y = 10 mm; the estimate is 20 mm beside it before contact, ``error_mm`` after."""
    x = np.linspace(0.0, 0.05, N)
    truth = np.stack([x, np.full(N, 0.01)], axis=1)
    off = np.where((x >= 0.020) & (x <= 0.040), error_mm * 1e-3, 0.020)
    return LiveSweep(
        number=number,
        stamp_ns=1_000_000_000 + (np.arange(N) * 10_000_000),
        mean=truth + np.stack([np.zeros(N), off], axis=1),
        truth=truth,
        trace=np.full(N, 1e-6),
        converged=np.arange(N) >= converged_from,
        contact=contact,
    )


def test_errors_count_between_contact_and_feature_end():
    assert sweep(error_mm=1.5).outcome()["error_after_contact_mm"] == pytest.approx(1.5)


def test_the_error_while_converged_is_separate():
    one = sweep(error_mm=1.5, converged_from=60)
    one.mean[40:60] += 0.01
    outcome = one.outcome()
    assert outcome["error_converged_mm"] == pytest.approx(1.5)
    assert outcome["error_after_contact_mm"] > 5.0
    assert sweep(converged_from=N).outcome()["error_converged_mm"] is None


def test_time_to_convergence_is_from_the_start_of_the_sweep():
    outcome = sweep(converged_from=60).outcome()
    assert outcome["time_to_convergence_s"] == pytest.approx(0.6)
    assert outcome["travel_to_convergence_mm"] == pytest.approx(30.0)
    assert outcome["converged"]
    assert not outcome["converged_before_contact"]


def test_convergence_before_contact_is_reported():
    assert sweep(converged_from=10).outcome()["converged_before_contact"]


def test_a_sweep_that_never_converged_has_no_time():
    outcome = sweep(converged_from=N).outcome()
    assert outcome["time_to_convergence_s"] is None
    assert not outcome["converged"]


def test_a_sweep_without_contact_has_no_error_after_it():
    outcome = sweep(contact=None).outcome()
    assert outcome["error_after_contact_mm"] is None
    assert outcome["converged_before_contact"], "it converged without contact"


@pytest.mark.parametrize(("errors_mm", "within"), [((2.0, 3.0), True), ((2.0, 3.2), False)])
def test_the_limit_applies_to_the_mean_of_the_sweeps(errors_mm, within):
    summary = summarize([sweep(error) for error in errors_mm])
    assert summary["error_after_contact_mm"] == pytest.approx(np.mean(errors_mm))
    assert summary["within_limit"] is within


def test_converged_sweeps_are_counted():
    assert summarize([sweep(), sweep(converged_from=N)])["converged_sweeps"] == 1


def test_no_sweeps_give_no_numbers():
    summary = summarize([])
    assert (summary["error_after_contact_mm"], summary["within_limit"]) == (None, False)


def test_contact_is_that_of_the_simulator():
    scan = simulate_scan("bump", seed=1, kind="test", sweeps=3)
    for number in range(3):
        contact = contact_of("bump", 1, number, SPEED_MPS, RATE_HZ)
        assert contact.first == scan.truth[scan.contact[number], 0]
        assert contact.last == scan.truth[scan.feature_end[number], 0]
    assert contact_of("none", 1, 0, SPEED_MPS, RATE_HZ) is None


def test_figures_show_every_sweep_and_the_limit(tmp_path):
    sweeps = [sweep(number=number) for number in range(4)]
    figure = error_along_the_sweep(sweeps, "bump")
    error, trace, share = figure.axes[:3]
    assert len(error.lines) == 4 + 1 + 1, "each sweep, their mean, the limit"
    assert len(trace.lines) == 5
    np.testing.assert_allclose(share.lines[0].get_ydata()[[0, -1]], [0.0, 1.0])
    figure.savefig(tmp_path / "error.png")
    assert (tmp_path / "error.png").stat().st_size > 10_000
