"""Strain of all phalanges in one cycle, and totals of frames and cycles."""

from __future__ import annotations

from array import array
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Cycle:
    """Strain of F phalanges in one cycle of the load cells.

    Attributes
    ----------
    stamp_ns : receive time of the first frame, ns
    strain : (C,) V, row-major; NaN where missing
    status : (F,) uint8 bits of :mod:`~tactile_localizer.io.status`
    sequence : (F,) uint32, unwrapped counter of the load cell; number of the cycle if it has no counter
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
    missing : cycles without voltages of this phalanx
    gaps : samples of which no frame was received, according to the counter
    drops : frames sent that are in no cycle, according to the counter
    saturated, faults : samples with that status
    unaligned : samples received while their cycle was uncertain
    interleaved : frames whose counter is repeated, earlier, or alternates between two sequences; many of
        them indicate two senders with the same identifiers
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
    """Totals since the assembler was created.

    Attributes
    ----------
    frames : number of frames of each kind; every frame has exactly one kind
    cycles, incomplete : all cycles, and those with a phalanx missing
    phalanges : totals of each phalanx
    """

    frames: list[int]
    cycles: int = 0
    incomplete: int = 0
    phalanges: list[PhalanxCounts] = field(default_factory=list)
