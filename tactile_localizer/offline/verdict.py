"""The verdict of a replay: one definition of success for the commands, the demo and the benchmarks."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from tactile_localizer.errors import counted
from tactile_localizer.offline.axes import describe_sizes
from tactile_localizer.offline.metrics import deviation, travel_from_contact
from tactile_localizer.offline.replay import ReplayedSweep


class Outcome(Enum):
    """How a sweep ended, from bad to good; :class:`Verdict` says when each holds."""

    WRONG = "wrong"
    NEVER = "never converged"
    LOST = "not converged at its end"
    RIGHT = "right"
    NO_CONTACT = "no contact"


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
    lost : of the expected sweeps, those that were never wrong, and are not converged at their end any more
    never : of the expected sweeps, those that never converged
    has_truth : whether the true positions of any sweep are known
    notes : a line for each expected sweep that is not right, with the reason
    """

    sweeps: int
    expected: int
    right: int
    wrong: int
    early: int
    lost: int
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
            f"{'localized' if self.success else 'NOT localized'}: "
            f"{self.right} of {counted(self.expected, 'sweep')} "
            f"{'right' if self.has_truth else 'converged'}, {self.wrong} ever wrong, "
            f"{self.lost} lost again, {self.never} never" + f"; {self.early} early" * (self.early > 0)
        )


def judge(sweeps: Sequence[ReplayedSweep]) -> Verdict:
    """Verdict on the sweeps of a replay, with their contact (:func:`~.offline.metrics.with_contact`)."""
    outcomes = [outcome(sweep) for sweep in sweeps]
    count, early, notes = Counter(outcomes), 0, []
    for sweep, found in zip(sweeps, outcomes, strict=True):
        first = sweep.contact[0]
        is_early = (sweep.converged & ((sweep.row < first) | (first < 0))).any()
        early += bool(sweep.contact_known and is_early)
        if found is Outcome.WRONG:
            off = describe_sizes(sweep.scene, np.abs(deviation(sweep)[relative_error(sweep).argmax()]))
            notes.append(f"sweep {sweep.number} was converged to a wrong position, off by {off}")
        elif found in (Outcome.NEVER, Outcome.LOST):
            notes.append(f"sweep {sweep.number} {_reason(sweep)}")
    return Verdict(
        sweeps=len(sweeps),
        expected=len(sweeps) - count[Outcome.NO_CONTACT],
        right=count[Outcome.RIGHT],
        wrong=count[Outcome.WRONG],
        early=early,
        lost=count[Outcome.LOST],
        never=count[Outcome.NEVER],
        has_truth=any(sweep.truth is not None for sweep in sweeps),
        notes=tuple(notes),
    )


def outcome(sweep: ReplayedSweep) -> Outcome:
    """How a sweep ended."""
    in_contact = sweep.converged[sweep.on_contact]
    if (relative_error(sweep) > 1.0).any():
        return Outcome.WRONG
    if not sweep.converged.any():
        touched = sweep.travel[sweep.on_contact]
        brushes = sweep.contact_known and (touched[-1:] - touched[:1]).sum() < sweep.criteria.sustain
        return Outcome.NO_CONTACT if brushes else Outcome.NEVER
    is_right = in_contact[-1:].any() or sweep.converged[-1]
    return Outcome.RIGHT if is_right else Outcome.LOST


def relative_error(sweep: ReplayedSweep) -> np.ndarray:
    """Error while converged by the convergence radius, (n,); more than 1 is wrong, 0 also where unknown."""
    error = np.nan_to_num(deviation(sweep)) * sweep.converged[:, None]
    return np.linalg.norm(error / sweep.criteria.radius, axis=1)


def worst_sweep(sweeps: Sequence[ReplayedSweep]) -> int | None:
    """Index of the sweep of the largest wrong claim, else one that is not right, else the last to converge.

    ``None`` where no sample was usable.
    """

    def badness(index: int) -> tuple[float, ...]:
        found, arrived = outcome(sweeps[index]), travel_from_contact(sweeps[index])[sweeps[index].converged]
        error = relative_error(sweeps[index]).max() * (found is Outcome.WRONG)
        return error, found in (Outcome.NEVER, Outcome.LOST), found is Outcome.RIGHT, arrived[:1].sum()

    return max((index for index, sweep in enumerate(sweeps) if len(sweep)), key=badness, default=None)


def _reason(sweep: ReplayedSweep) -> str:
    """Why a sweep that was never wrong is not right."""
    if not len(sweep):
        return "did not converge: no usable sample"
    reason = sweep.reason[-1].partition(": ")[2] or sweep.reason[-1]
    what = "did not converge" if not sweep.converged.any() else "did not stay converged"
    return f"{what}: {sweep.state[-1].value} at its end; {reason}"
