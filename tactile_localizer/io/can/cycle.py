"""A cycle of the load cells, and the totals that are kept of frames and cycles."""

from __future__ import annotations

from array import array
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Cycle:
    """What F phalanges felt in one cycle.

    Attributes
    ----------
    stamp_ns : receive time of the first frame, ns
    strain : (C,) V, row-major; NaN where missing
    status : (F,) uint8 bits of :mod:`~tactile_localizer.io.status`
    sequence : (F,) uint32, the load cell's counter, unwrapped; the cycle's number where it has none
    """

    stamp_ns: int
    strain: np.ndarray
    status: array[int]
    sequence: array[int]


@dataclass
class PhalanxCounts:
    """Totals of one phalanx.

    Attributes
    ----------
    samples : complete samples
    missing : cycles published without this phalanx's voltages
    gaps : samples of which no frame arrived, by the counter
    drops : frames sent that are in no cycle, by the counter
    saturated, faults : samples with that status
    unaligned : samples received while it was not certain which cycle they belong to
    interleaved : frames whose counter is repeated, earlier, or alternates between two sequences: many of them
        where two senders have the same identifiers
    last_ns : receive time of the last frame used, ns; 0 before the first
    """

    samples: int = 0
    missing: int = 0
    gaps: int = 0
    drops: int = 0
    saturated: int = 0
    faults: int = 0
    unaligned: int = 0
    interleaved: int = 0
    last_ns: int = 0


@dataclass
class Counts:
    """Totals since the assembler was made.

    Attributes
    ----------
    frames : frames by kind; each frame given is in exactly one of them
    cycles, incomplete : cycles made, and those of them with a phalanx missing
    phalanges : totals of each phalanx
    """

    frames: list[int]
    cycles: int = 0
    incomplete: int = 0
    phalanges: list[PhalanxCounts] = field(default_factory=list)
