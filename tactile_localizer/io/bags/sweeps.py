"""Topics of a bag, and marks of its sweeps from what the nodes report."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

from tactile_localizer.streams.session import Session
from tactile_localizer.streams.sweep_detector import NO_SWEEP

TOPICS = {
    "strain": ("/strain", "strain vectors"),
    "pose": ("/palm_pose", "measured palm poses"),
    "truth": ("/tactile_simulator/ground_truth", "true palm poses"),
    "status": ("/tactile_mapping/status", "status of the mapping node, for its sweeps"),
    "posterior": ("/tactile_filter/posterior", "posterior of the filter node, for global localizations"),
    "active": ("/tactile_simulator/sweep_active", "whether a sweep is in progress, for the localized sweeps"),
}
"""Default topics and their content by name; a bag must have the first two."""


class Mark(NamedTuple):
    """After a stamp of a run of the strain, ns, ``sweep`` is in progress; see :meth:`.Session.mark`."""

    run: int
    after_ns: int
    sweep: int


class Travel(NamedTuple):
    """Content of a ``Posterior`` in a run of the strain: travel since the last global localization, m."""

    run: int
    stamp_ns: int
    travel_m: float


class Reports:
    """Runs of what a node reports of the strain, also where it is received after the next jump back."""

    def __init__(self) -> None:
        self._run, self._stamp_ns = 0, 0

    def run_of(self, stamp_ns: int, session: Session[Any]) -> int:
        """The run of the next report by its stamp, ns: the last one, until the strain of another is there."""
        newest_ns = (session.newest_ns or 0) + max(session.delay_ns, 0)
        if stamp_ns < self._stamp_ns or stamp_ns <= newest_ns:
            self._run = session.run
        self._stamp_ns = stamp_ns
        return self._run


WHOLE_BAG = Mark(0, -1, 1)
"""All samples are in one sweep."""


def localized_sweeps(flags: Sequence[Mark], travels: Sequence[Travel]) -> Sequence[Mark]:
    """Sweeps that the filter localized, numbered from 1.

    They are those while a ``Bool`` is true, after the filter has begun; without such messages, they begin at
    its global localizations, which reset the travelled distance to zero.
    """
    if flags:
        turns = [each for before, each in pairwise([Mark(0, -1, 0), *flags]) if each.sweep != before.sweep]
        first = travels[0][:2] if travels else (0, -1)
        early = sum(each[:2] <= first for each in turns[1::2])  # that ended before
        turns = turns[2 * early :]
        numbered = [each._replace(sweep=NO_SWEEP if at % 2 else at // 2 + 1) for at, each in enumerate(turns)]
        return [Mark(0, -1, NO_SWEEP), *numbered]
    # Where the stamps jump back the filter begins anew, so the first of a run is no reset.
    resets = [
        after
        for before, after in pairwise(travels)
        if before.run == after.run and after.travel_m == 0.0 < before.travel_m
    ]
    begun = [*travels[:1], *resets]
    return [Mark(each.run, each.stamp_ns - 1, number) for number, each in enumerate(begun, 1)]
