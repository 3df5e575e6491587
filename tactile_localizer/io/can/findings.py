"""Findings about the frames of load cells, in the words of the driver and of the import of a log."""

from collections.abc import Mapping

from tactile_localizer.io.can.counter import TWO_SENDERS
from tactile_localizer.io.can.protocol import FrameKind

_MIN_JUMPS = 10
_JUMPS_FRACTION = 0.2
"""Fraction of samples before which the counter jumps, from which two load cells send them (judgement)."""

_SUSPECT = (FrameKind.WRONG_LENGTH, FrameKind.OUT_OF_ORDER, FrameKind.DUPLICATE)
"""Kinds of frames with an identifier of the DBC that were not used."""


def describe_discarded(frames: Mapping[FrameKind, int]) -> str:
    """Frames that were discarded although they have an identifier of the DBC; empty without any.

    Parameters
    ----------
    frames : number of frames by their kind
    """
    counts = [f"{frames[kind]} {kind.name.lower()}" for kind in _SUSPECT if frames.get(kind)]
    return f"discarded frames: {', '.join(counts)}".replace("_", " ") if counts else ""


def are_of_two(jumps: int, cycles: int) -> bool:
    """Whether a counter jumps so often that two load cells send frames with its identifiers.

    Parameters
    ----------
    jumps : number of frames whose counter neither continues nor shows losses
    cycles : number of cycles with or without the phalanx
    """
    return jumps > max(_MIN_JUMPS, _JUMPS_FRACTION * cycles)


def describe_counter(problem: str, jumps: int, cycles: int) -> str:
    """What is wrong with the counter of a load cell beside losses, in one line; empty if nothing is.

    Parameters
    ----------
    problem : reason why it is not used, continuing "the counter"; else empty
    jumps, cycles : as in :func:`are_of_two`
    """
    if problem:
        return f"the counter {problem}: losses are not counted; set counter_signal to ''"
    if are_of_two(jumps, cycles):
        return f"the counter jumped {jumps} times: {TWO_SENDERS}"
    return "the counter restarted: the load cell restarted, or another one has its identifiers" * bool(jumps)
