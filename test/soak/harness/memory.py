"""How much memory processes take, and whether it grows."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

_PAGE = os.sysconf("SC_PAGE_SIZE")
_SHARE = 0.2
"""Of the samples, at either end, whose medians are compared: a message more or less is no growth."""


def resident_bytes(pid: int) -> int:
    """What a process holds in memory, bytes; 0 when it has ended."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * _PAGE
    except OSError:
        return 0


@dataclass
class Memory:
    """The resident memory of one process.

    Attributes
    ----------
    warm_up : number of samples at the start that do not count
    samples : bytes, in the order of time
    """

    warm_up: int = 0
    samples: list[int] = field(default_factory=list)

    @property
    def first_bytes(self) -> float:
        """After the warm-up."""
        return self._median(self.samples[self.warm_up :][: self._count])

    @property
    def last_bytes(self) -> float:
        """At the end."""
        return self._median(self.samples[-self._count :])

    @property
    def growth_bytes(self) -> float:
        """From the warm-up to the end."""
        return self.last_bytes - self.first_bytes

    @property
    def _count(self) -> int:
        return max(1, round(_SHARE * (len(self.samples) - self.warm_up)))

    @staticmethod
    def _median(samples: Sequence[int]) -> float:
        return float(np.median(samples)) if samples else 0.0
