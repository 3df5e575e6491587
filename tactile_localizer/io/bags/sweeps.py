"""Boundaries of the sweeps in a bag, from the messages of a node or from the motion."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from tactile_localizer.core.scan.sweep_detector import SweepDetector
from tactile_localizer.io.bags.decode import stamp_of

_END_NS = 2**63 - 1
"""A stamp later than that of any sample, ns: the largest 64-bit integer."""


class Span(NamedTuple):
    """Boundaries of a sweep: samples with stamps later than ``after_ns`` up to ``until_ns``."""

    number: int
    after_ns: int
    until_ns: int


WHOLE_BAG = Span(1, -1, _END_NS)


class StatusChange(NamedTuple):
    """Content of a ``ScanStatus``: from ``stamp_ns`` on, sweep ``number`` is recorded, or none."""

    stamp_ns: int
    is_active: bool
    number: int

    @classmethod
    def of_message(cls, message: Any) -> StatusChange:
        """Convert a message object."""
        return cls(stamp_of(message), bool(message.sweep_active), int(message.sweep))


class Travel(NamedTuple):
    """Content of a ``Posterior``: distance travelled since the last global localization, m."""

    stamp_ns: int
    travel_m: float

    @classmethod
    def of_message(cls, message: Any) -> Travel:
        """Convert a message object."""
        return cls(stamp_of(message), float(message.travel))


def moving_spans(detector: SweepDetector, stamp_ns: np.ndarray, position: np.ndarray) -> list[Span]:
    """Sweeps detected in the motion.

    Parameters
    ----------
    detector : in its initial state
    stamp_ns : (n,) rising stamps, ns
    position : (n, d) palm positions, m (yaw: rad)
    """
    numbers = np.array(
        [detector.update(int(t), p) for t, p in zip(stamp_ns, position, strict=True)], dtype=int
    )
    starts = np.flatnonzero(np.diff(numbers, prepend=0))
    ends = np.append(stamp_ns[starts], _END_NS)[1:]
    return [
        Span(int(numbers[start]), int(stamp_ns[start]) - 1, int(end) - 1)
        for start, end in zip(starts, ends, strict=True)
        if numbers[start]
    ]


def status_spans(changes: Sequence[StatusChange]) -> list[Span]:
    """Sweeps between the stamps at which the mapping node's status changed."""
    spans = []
    begun: StatusChange | None = None
    for change in changes:
        if begun is not None and (not change.is_active or change.number != begun.number):
            spans.append(Span(begun.number, begun.stamp_ns, change.stamp_ns))
            begun = None
        if change.is_active and begun is None:
            begun = change  # a stamp of 0 is valid: it means before the first sample
    if begun is not None:
        spans.append(Span(begun.number, begun.stamp_ns, _END_NS))
    return spans


def localization_spans(travels: Sequence[Travel]) -> list[Span]:
    """Sweeps between global localizations, which reset the travelled distance to zero."""
    begun = [travels[0].stamp_ns]
    begun += [
        after.stamp_ns for before, after in pairwise(travels) if after.travel_m == 0.0 < before.travel_m
    ]
    ends = [*(stamp_ns - 1 for stamp_ns in begun[1:]), _END_NS]
    return [
        Span(number, first - 1, end) for number, (first, end) in enumerate(zip(begun, ends, strict=True), 1)
    ]
