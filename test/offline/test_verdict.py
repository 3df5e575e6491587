"""The verdict of a replay."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.replays import SHEET, replayed

from tactile_localizer.offline.verdict import judge, worst_sweep
from tactile_localizer.scene import Axis

OFF = 0.0262
TOUCHES = {"contact": (3, 7), "contact_known": True}
NONE = {"contact": (-1, -1), "contact_known": True}
LATE = np.arange(10) >= 4
"""Converged from the estimate after contact on."""


def wide(sweep, radius):
    """The sweep with another radius of convergence on each axis, m (yaw: rad)."""
    return replace(sweep, criteria=replace(sweep.criteria, radius=np.full(2, radius)))


def counts(*sweeps):
    verdict = judge(sweeps)
    return verdict.expected, verdict.right, verdict.wrong, verdict.early, verdict.never, verdict.success


@pytest.mark.parametrize(
    ("sweep", "expected"),
    [
        (replayed(np.zeros((10, 2)), converged=LATE, **TOUCHES), (1, 1, 0, 0, 0, True)),
        (replayed(np.zeros((10, 2)), converged=LATE, truth=False), (1, 1, 0, 0, 0, True)),
        (replayed(np.zeros((10, 2)), **TOUCHES), (1, 0, 0, 0, 1, False)),
        (replayed(np.zeros((10, 2))), (1, 0, 0, 0, 1, False)),
        (replayed(np.zeros((10, 2)), converged=np.arange(10) == 5, **TOUCHES), (1, 0, 0, 0, 0, False)),
        (replayed(np.zeros((10, 2)), converged=LATE & (np.arange(10) < 8), **TOUCHES), (1, 1, 0, 0, 0, True)),
        (replayed(np.zeros((10, 2)), converged=np.arange(10) > 8, **TOUCHES), (1, 1, 0, 0, 0, True)),
        (replayed(np.zeros((10, 2)), converged=np.arange(10) < 8), (1, 0, 0, 0, 0, False)),
        (replayed(np.zeros((10, 2)), converged=np.arange(10) >= 2, **TOUCHES), (1, 1, 0, 1, 0, True)),
        (replayed(np.zeros((10, 2)), contact=(3, 3), contact_known=True), (0, 0, 0, 0, 0, False)),
        (replayed(np.zeros((10, 2)), **NONE), (0, 0, 0, 0, 0, False)),
        (replayed(np.full((10, 2), OFF), converged=LATE, **NONE), (1, 0, 1, 1, 0, False)),
        (replayed(np.empty((0, 2))), (1, 0, 0, 0, 1, False)),
    ],
    ids=["right", "no truth", "never", "never, contact unknown", "at no end", "lost past the feature",
         "found past it", "not at its end", "early", "brushed", "blank", "wrong on blank", "empty"],
)  # fmt: skip
def test_a_sweep_is_counted_by_its_outcome(sweep, expected) -> None:
    assert counts(sweep) == expected


def test_a_sweep_that_was_ever_converged_off_the_position_is_wrong() -> None:
    errors = np.zeros((10, 2))
    errors[5, 0] = OFF  # one estimate of six that are converged
    wrong = replayed(errors, converged=LATE, number=4, **TOUCHES)
    right = replayed(np.zeros((10, 2)), converged=LATE, **TOUCHES)
    assert counts(right, wrong) == (2, 1, 1, 0, 0, False)
    verdict = judge([right, wrong])
    assert verdict.notes == ("sweep 4 was converged to a wrong position, off by x 26.20 mm, y 0.00 mm",)
    assert str(verdict) == ("NOT localized: 1 of 2 sweeps right, 1 ever wrong, 0 lost again, 0 never")
    assert judge([wide(right, 0.03), wide(wrong, 0.03)]).success
    assert counts(right, replayed(errors, converged=np.arange(10) > 5, **TOUCHES))[-1]


def test_the_line_of_eighteen_sweeps_fits_a_terminal() -> None:
    early = replayed(np.zeros((10, 2)), converged=np.arange(10) >= 2, **TOUCHES)
    line = str(judge([early] * 18))
    assert line.endswith("18 of 18 sweeps right, 0 ever wrong, 0 lost again, 0 never; 18 early")
    assert len(line) <= 80


def test_a_wrong_yaw_is_a_wrong_position() -> None:
    scene = replace(SHEET, axes=(SHEET.axes[0], Axis("yaw", -math.pi, math.pi)))
    turned = replayed([[0.0, 2 * math.pi - 0.1], [0.0, 0.3]], converged=[True, True], scene=scene)
    assert judge([wide(turned, 0.15)]).wrong == 1
    assert judge([wide(turned, 0.4)]).success


def test_the_worst_sweep_is_wrong_else_not_right_else_the_last_to_converge() -> None:
    soon = replayed(np.zeros((10, 2)), converged=LATE, **TOUCHES)
    late = replayed(np.zeros((10, 2)), converged=np.arange(10) >= 6, **TOUCHES)
    blank, empty = replayed(np.zeros((10, 2)), **NONE), replayed(np.empty((0, 2)))
    never = replayed(np.zeros((10, 2)), **TOUCHES)
    off = replayed(np.full((10, 2), OFF), converged=LATE, **TOUCHES)
    farther = replayed(np.full((10, 2), 2 * OFF), converged=LATE, **TOUCHES)
    sweeps = [blank, soon, late, never, off, farther]
    for count in range(1, len(sweeps) + 1):
        assert worst_sweep([*sweeps[:count], empty]) == count - 1
    assert worst_sweep([empty]) is None
