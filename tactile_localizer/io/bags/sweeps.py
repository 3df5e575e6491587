"""Topics of a bag, and boundaries of its sweeps as the nodes report them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

TOPICS = {
    "strain": ("/strain", "strain vectors"),
    "pose": ("/palm_pose", "measured palm poses"),
    "truth": ("/tactile_simulator/ground_truth", "true palm poses"),
    "status": ("/tactile_mapping/status", "status of the mapping node, for its sweeps"),
    "posterior": ("/tactile_filter/posterior", "posterior of the filter node, for global localizations"),
    "active": ("/tactile_simulator/sweep_active", "whether a sweep is in progress, for the localized sweeps"),
}
"""Default topics and their content by name; a bag must have the first two."""

_END_NS = 2**63 - 1
"""A stamp later than that of any sample, ns: the largest 64-bit integer."""


class Span(NamedTuple):
    """Boundaries of a sweep: samples with stamps later than ``after_ns`` up to ``until_ns``."""

    number: int
    after_ns: int
    until_ns: int


WHOLE_BAG = Span(1, -1, _END_NS)


class Change(NamedTuple):
    """From ``stamp_ns`` on, sweep ``number`` is in progress; 0: none."""

    stamp_ns: int
    number: int


class Travel(NamedTuple):
    """Content of a ``Posterior``: distance travelled since the last global localization, m."""

    stamp_ns: int
    travel_m: float


def spans(changes: Sequence[Change]) -> list[Span]:
    """Sweeps between the stamps at which the number of the sweep in progress changed."""
    turns = [each for before, each in pairwise([Change(-1, 0), *changes]) if each.number != before.number]
    return [
        Span(begun.number, begun.stamp_ns, ended.stamp_ns)
        for begun, ended in pairwise([*turns, Change(_END_NS, 0)])
        if begun.number
    ]


def localized_spans(changes: Sequence[Change], travels: Sequence[Travel]) -> list[Span]:
    """Sweeps that the filter localized, numbered from 1.

    They are those while a ``Bool`` is true, after the filter has begun; without such messages, they begin at
    its global localizations, which reset the travelled distance to zero; without either, all is one.
    """
    if changes:
        first_ns = travels[0].stamp_ns if travels else -1
        localized = [span for span in spans(changes) if span.until_ns > first_ns]
        return [Span(number, span.after_ns, span.until_ns) for number, span in enumerate(localized, 1)]
    # Where the stamps jump back the filter begins anew, so the first of a run is no reset.
    here = [each for each in travels if each.stamp_ns >= 0]
    resets = [after for before, after in pairwise(here) if after.travel_m == 0.0 < before.travel_m]
    begun = [Change(each.stamp_ns - 1, number) for number, each in enumerate([*travels[:1], *resets], 1)]
    return spans(begun) or [WHOLE_BAG]
