"""Findings about the clocks and the poses of a session: what is measured, from where on, and what is said.

Each displaces a map without a trace in the strain. The thresholds are judgement.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from tactile_localizer.scene import Axis
from tactile_localizer.streams.arrivals import Measure, Seen
from tactile_localizer.streams.clocks import difference, duration, lead, outside, spacing
from tactile_localizer.streams.palm_motion import holding, jumping, stillness

CLOCKS, MOTION = "clocks", "motion"


class Finding(NamedTuple):
    """A row of the table.

    Parameters
    ----------
    name : short name
    of : :data:`CLOCKS` or :data:`MOTION`; the first of each that holds is reported
    measure : gives values, with what else the sentence names
    above : size of a value above which it is reported
    sentence : what is said of it
    is_live : whether it is a warning of the nodes too; the others take all of a recording
    """

    name: str
    of: str
    measure: Callable[[Seen], Measure]
    above: float
    sentence: str
    is_live: bool


FINDINGS = (
    Finding(
        "duration",
        CLOCKS,
        duration,
        2.0,
        "the poses are of another recording? they last {pose_s:.3g} s, the strain {strain_s:.3g} s: {ranges}",
        is_live=False,
    ),
    Finding(
        "difference",
        CLOCKS,
        difference,
        0.0,
        "the poses are {size:.15g} s {way} the strain, another {what}? {ranges}",
        is_live=False,
    ),
    Finding(
        "outside",
        CLOCKS,
        outside,
        0.5,
        "most of the strain is before or after all poses: {ranges}",
        is_live=False,
    ),
    Finding(
        "spacing",
        CLOCKS,
        spacing,
        1.0,
        "the poses are {apart_s:.2g} s apart, and positions are interpolated across at most {most_s:g} s: "
        "{option} {wider_s:.2g} is right if the motion is smooth",
        is_live=True,
    ),
    Finding(
        "lead",
        CLOCKS,
        lead,
        0.1,
        "stamps are {size:.2f} s {way} the strain received with them: another clock, or the time of sending?",
        is_live=True,
    ),
    Finding(
        "stillness", MOTION, stillness, 0.5, "the position does not change over {size:.1f} s", is_live=True
    ),
    Finding(
        "jumping",
        MOTION,
        jumping,
        0.05,
        "the position jumps by {size:.2g}{unit} within {ms:.2g} ms and back: two sources, or noise",
        is_live=True,
    ),
    Finding(
        "holding",
        MOTION,
        holding,
        0.5,
        "the position is held for {ms:.0f} ms, then steps by {size:.2g}{unit}: a slow source",
        is_live=True,
    ),
)


class Found(NamedTuple):
    """A finding that holds, its value, and what it says, in one line."""

    name: str
    value: float
    text: str


def findings(seen: Seen, *, of: str = "", live: bool = False, moves: bool = False) -> Iterator[Found]:
    """What holds of what was seen: the first about the clocks, and the first about the motion.

    Parameters
    ----------
    seen : strain and poses
    of : :data:`CLOCKS` or :data:`MOTION`, if only these are wanted
    live : whether ``seen`` is the last part of a session that goes on
    moves : whether it is implausible that the palm is at rest all the time
    """
    reported = set()
    for row in FINDINGS:
        is_wanted = of in (row.of, "") and (row.is_live or not live) and (moves or row.name != "stillness")
        has_data = len(seen.pose_ns) and (len(seen.strain_ns) or row.of == MOTION)
        if row.of in reported or not is_wanted or not has_data:
            continue
        for value, words in row.measure(seen):
            if abs(value) > row.above:
                way = "ahead of" if value > 0.0 else "behind"
                text = row.sentence.format(**{"size": abs(value), "way": way, **words})
                reported.add(row.of)
                yield Found(row.name, value, text)
                break


def describe_motion(
    axes: tuple[Axis, ...], stamp_ns: np.ndarray, position: np.ndarray, moves: bool = True
) -> str:
    """What is implausible about palm positions, in one line; empty if nothing is.

    Positions that jump there and back are from two sources, such as two publishers of one topic. Positions
    that are held and then step are from a source that is slower than their stamps.

    Parameters
    ----------
    axes : the d axes; the motion is that in x and y, and that of a fingertip where the palm turns
    stamp_ns : (n,) rising stamps, ns, of measured poses rather than of strain between them
    position : (n, d) palm positions, m (yaw: rad), finite
    moves : whether it is implausible that the palm is at rest all the time
    """
    seen = Seen(axes, stamp_ns[:0], stamp_ns, position, 0.0)
    return next((found.text for found in findings(seen, of=MOTION, moves=moves)), "")
