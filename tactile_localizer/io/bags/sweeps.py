"""Topics of a bag, and boundaries of its sweeps as the nodes report them."""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from tactile_localizer.io.recording import NO_SWEEP

TOPICS = {
    "strain": ("/strain", "strain vectors"),
    "pose": ("/palm_pose", "measured palm poses"),
    "truth": ("/tactile_simulator/ground_truth", "true palm poses"),
    "status": ("/tactile_mapping/status", "status of the mapping node, for its sweeps"),
    "posterior": ("/tactile_filter/posterior", "posterior of the filter node, for global localizations"),
    "active": ("/tactile_simulator/sweep_active", "whether a sweep is in progress, for the localized sweeps"),
}
"""Default topics and their content by name; a bag must have the first two."""


class Change(NamedTuple):
    """After ``stamp_ns``, sweep ``number`` is in progress, or :data:`NO_SWEEP`."""

    stamp_ns: int
    number: int


class Travel(NamedTuple):
    """Content of a ``Posterior``: distance travelled since the last global localization, m."""

    stamp_ns: int
    travel_m: float


WHOLE_BAG = (Change(-1, 1),)
"""All samples are in one sweep."""


def sweeps_at(changes: Sequence[Change], stamp_ns: np.ndarray) -> np.ndarray:
    """Numbers (n,) of the sweeps in progress at stamps (n,), ns: those of the last change before each."""
    numbers = np.array([NO_SWEEP, *(each.number for each in changes)])
    return numbers[np.searchsorted([each.stamp_ns for each in changes], stamp_ns)]


def localized_changes(changes: Sequence[Change], travels: Sequence[Travel]) -> Sequence[Change]:
    """Sweeps that the filter localized, numbered from 1.

    They are those while a ``Bool`` is true, after the filter has begun; without such messages, they begin at
    its global localizations, which reset the travelled distance to zero; without either, all is one.
    """
    if changes:
        turns = [each for before, each in pairwise([Change(-1, 0), *changes]) if each.number != before.number]
        first_ns = travels[0].stamp_ns if travels else -1
        early = sum(each.stamp_ns <= first_ns for each in turns[1::2])  # that ended before
        turns = turns[2 * early :]
        return [Change(each.stamp_ns, NO_SWEEP if at % 2 else at // 2 + 1) for at, each in enumerate(turns)]
    # Where the stamps jump back the filter begins anew, so the first of a run is no reset.
    here = [each for each in travels if each.stamp_ns >= 0]
    resets = [after for before, after in pairwise(here) if after.travel_m == 0.0 < before.travel_m]
    begun = [Change(each.stamp_ns - 1, number) for number, each in enumerate([*travels[:1], *resets], 1)]
    return begun or WHOLE_BAG
