"""Resident memory of processes, and its growth."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

_PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")

_END_FRACTION = 0.2
"""Fraction of the samples at each end whose medians are compared, so that single messages do not count."""


def resident_bytes(pid: int) -> int:
    """Resident memory of a process, bytes; 0 if it has ended."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * _PAGE_BYTES
    except OSError:
        return 0


@dataclass
class Memory:
    """The resident memory of one process.

    Attributes
    ----------
    warm_up : number of samples at the start that are ignored
    samples : resident memory over time, bytes
    """

    warm_up: int = 0
    samples: list[int] = field(default_factory=list)

    @property
    def first_bytes(self) -> float:
        """Memory after the warm-up, bytes."""
        return self._median(self.samples[self.warm_up :][: self._count])

    @property
    def last_bytes(self) -> float:
        """Memory at the end, bytes."""
        return self._median(self.samples[-self._count :])

    @property
    def growth_bytes(self) -> float:
        """Growth from the warm-up to the end, bytes."""
        return self.last_bytes - self.first_bytes

    @property
    def _count(self) -> int:
        return max(1, round(_END_FRACTION * (len(self.samples) - self.warm_up)))

    @staticmethod
    def _median(samples: Sequence[int]) -> float:
        return float(np.median(samples)) if samples else 0.0
