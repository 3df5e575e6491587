"""The verdict of a replay: one definition of success for the commands, the demo and the benchmarks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import convergence_criteria
from tactile_localizer.core.hypotheses.convergence import ConvergenceCriteria
from tactile_localizer.offline.axes import describe_sizes
from tactile_localizer.offline.metrics import deviation, travel_from_contact
from tactile_localizer.offline.replay import ReplayedSweep
from tactile_localizer.scene import Scene


@dataclass(frozen=True)
class Verdict:
    """Numbers of sweeps by their outcome.

    A sweep is *wrong* if it is ever converged with an error beyond the convergence radius, at any estimate.
    It is *right* if it is converged at the end of its contact with the feature, or of the sweep, and was
    never wrong: past the feature nothing shows the position. Without a truth no sweep is wrong.
    To converge *early* is no failure where it is right: nobody who acts on the position is misled, and what
    is marked as contact is a threshold, below which a finger may feel the feature. A sweep that was early and
    off is wrong.

    Parameters
    ----------
    sweeps : all sweeps
    expected : sweeps that have to be right: all but those that touch no feature, or for less travel than
        convergence has to hold, and never converge
    right : sweeps that are right
    wrong : sweeps that were ever wrong
    early : sweeps that converged before contact, or without any
    never : of the expected sweeps, those that never converged
    has_truth : whether the true positions of any sweep are known
    notes : a line for each expected sweep that is not right, with the reason
    """

    sweeps: int
    expected: int
    right: int
    wrong: int
    early: int
    never: int
    has_truth: bool
    notes: tuple[str, ...]

    @property
    def success(self) -> bool:
        """Whether every expected sweep, and at least one, is right."""
        return self.right == self.expected > 0

    def __str__(self) -> str:
        if not self.expected:
            return "NOT localized: no sweep touches a feature or converges"
        return (
            f"{'localized' if self.success else 'NOT localized'}: {self.right} of {self.expected} sweeps "
            f"{'right' if self.has_truth else 'converged'}, {self.wrong} ever wrong, "
            f"{self.early} converged early, {self.never} never"
        )


def judge(
    scene: Scene, sweeps: Sequence[ReplayedSweep], configuration: Configuration | None = None
) -> Verdict:
    """Verdict on the sweeps of a replay.

    Parameters
    ----------
    scene : scene of the localizer
    sweeps : its estimates, with the contact of each sweep (:func:`~.offline.metrics.with_contact`)
    configuration : gives the criteria of convergence; default: those of the filter node
    """
    criteria = convergence_criteria(scene, configuration or Configuration())
    right = wrong = early = never = expected = 0
    notes = []
    for sweep in sweeps:
        converges, first = bool(sweep.converged.any()), sweep.contact[0]
        is_early = bool((sweep.converged & ((sweep.row < first) | (first < 0))).any())
        early += is_early and sweep.contact_known
        touched = sweep.travel[sweep.on_contact]
        brushes = sweep.contact_known and (touched[-1:] - touched[:1]).sum() < criteria.sustain
        if brushes and not converges:
            continue
        expected += 1
        never += not converges
        relative = relative_error(scene, sweep, criteria)
        if (relative > 1.0).any():
            wrong += 1
            worst = describe_sizes(scene, np.abs(deviation(scene, sweep)[relative.argmax()]))
            notes.append(f"sweep {sweep.number} was converged to a wrong position, off by {worst}")
        elif _is_converged_at_an_end(sweep):
            right += 1
        else:
            notes.append(f"sweep {sweep.number} {_reason(sweep)}")
    has_truth = any(sweep.truth is not None for sweep in sweeps)
    return Verdict(len(sweeps), expected, right, wrong, early, never, has_truth, tuple(notes))


def relative_error(scene: Scene, sweep: ReplayedSweep, criteria: ConvergenceCriteria) -> np.ndarray:
    """Error while converged by the convergence radius, (n,); more than 1 is wrong, 0 also where unknown."""
    error = np.nan_to_num(deviation(scene, sweep)) * sweep.converged[:, None]
    return np.linalg.norm(error / criteria.radius, axis=1)


def worst_sweep(
    scene: Scene, sweeps: Sequence[ReplayedSweep], configuration: Configuration | None = None
) -> int | None:
    """Index of the sweep of the largest wrong claim, else one that is not right, else the last to converge.

    Parameters
    ----------
    scene, sweeps, configuration : as for :func:`judge`
    """
    criteria = convergence_criteria(scene, configuration or Configuration())

    def badness(index: int) -> tuple[float, ...]:
        sweep = sweeps[index]
        verdict, error = judge(scene, [sweep], configuration), relative_error(scene, sweep, criteria).max()
        arrived = travel_from_contact(sweep)[sweep.converged][:1].sum()
        return verdict.wrong * error, verdict.expected - verdict.right, verdict.right, arrived

    return max((index for index, sweep in enumerate(sweeps) if len(sweep)), key=badness, default=None)


def _is_converged_at_an_end(sweep: ReplayedSweep) -> bool:
    """Whether a sweep is converged at the end of its contact, or at its own."""
    in_contact = sweep.converged[sweep.on_contact]
    return bool(in_contact[-1:].any() or sweep.converged[-1:].any())


def _reason(sweep: ReplayedSweep) -> str:
    """Why a sweep that was never wrong is not right."""
    if not len(sweep):
        return "did not converge: no usable sample"
    reason = sweep.reason[-1].partition(": ")[2] or sweep.reason[-1]
    what = "did not converge" if not sweep.converged.any() else "did not stay converged"
    return f"{what}: {sweep.state[-1].value} at its end; {reason}"
