"""Layout of a strain vector: the number of channels of each phalanx."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

DEFAULT_CHANNELS = 8
"""Default number of channels of a phalanx: the gauge pairs of a Robonaut 2 load cell."""


@dataclass(frozen=True)
class ChannelLayout:
    """Layout of a strain vector of C channels, grouped by its F phalanges.

    Parameters
    ----------
    counts : number of channels of each of the F phalanges, in the order of the strain vector
    """

    counts: tuple[int, ...]

    @classmethod
    def of(cls, counts: Sequence[int], phalanges: int) -> ChannelLayout:
        """The layout with ``counts`` channels; if empty, with the default for each of ``phalanges``."""
        return cls(tuple(map(int, counts)) or (DEFAULT_CHANNELS,) * phalanges)

    @property
    def phalanges(self) -> int:
        """Number of phalanges, F."""
        return len(self.counts)

    @cached_property
    def size(self) -> int:
        """Number of channels of all phalanges, C."""
        return sum(self.counts)

    @cached_property
    def widths(self) -> np.ndarray:
        """Number of channels of each phalanx, (F,) int."""
        return np.array(self.counts)

    @cached_property
    def bounds(self) -> np.ndarray:
        """Start index of each phalanx, followed by the total number of elements, (F + 1,) int."""
        return np.cumsum([0, *self.counts], dtype=np.intp)

    @cached_property
    def every(self) -> np.ndarray:
        """Flags (F,) of all phalanges, which cannot be changed."""
        flags = np.ones(self.phalanges, dtype=bool)
        flags.flags.writeable = False
        return flags

    @cached_property
    def slices(self) -> tuple[slice, ...]:
        """Elements of the strain vector that belong to each phalanx."""
        return tuple(slice(*ends) for ends in pairwise(self.bounds.tolist()))

    @cached_property
    def phalanx(self) -> np.ndarray:
        """Index of the phalanx that each element belongs to, (C,) int."""
        return np.repeat(np.arange(self.phalanges), self.counts)

    @cached_property
    def _starts(self) -> np.ndarray:
        return self.bounds[:-1]

    def expand(self, values: np.ndarray) -> np.ndarray:
        """Repeat one value per phalanx, (..., F), for each of its channels, (..., C)."""
        return np.asarray(values).take(self.phalanx, axis=-1)

    def split(self, values: np.ndarray) -> list[np.ndarray]:
        """Split values (..., C) by phalanx into F arrays (..., channels of the phalanx)."""
        return [values[..., part] for part in self.slices]

    def sum(self, values: np.ndarray) -> np.ndarray:
        """Sums over the channels of each phalanx, (..., C) to (..., F)."""
        return np.add.reduceat(values, self._starts, axis=-1)

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Means over the channels of each phalanx, (..., C) to (..., F)."""
        return self.sum(values) / self.widths

    def all(self, flags: np.ndarray) -> np.ndarray:
        """Whether all channels of each phalanx have their flag set, (..., C) to (..., F) bool."""
        return np.logical_and.reduceat(flags, self._starts, axis=-1)

    def any(self, flags: np.ndarray) -> np.ndarray:
        """Whether any channel of each phalanx has its flag set, (..., C) to (..., F) bool."""
        return np.logical_or.reduceat(flags, self._starts, axis=-1)

    def place(self, element: int) -> tuple[int, int]:
        """Phalanx index of an element of the strain vector, and its channel number there, from 1."""
        phalanx = int(self.phalanx[element])
        return phalanx, element - self.slices[phalanx].start + 1
