"""Which elements of a strain vector belong to which phalanx."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

DEFAULT_CHANNELS = 8
"""Channels of a phalanx whose number is not given: the gauge pairs of a Robonaut 2 load cell."""


@dataclass(frozen=True)
class ChannelLayout:
    """A strain vector of F phalanges and C channels in all: those of the first phalanx, of the second, ...

    Parameters
    ----------
    counts : channels of each phalanx, (F,) in the order of the strain vector
    """

    counts: tuple[int, ...]

    @classmethod
    def of(cls, counts: Sequence[int], phalanges: int) -> ChannelLayout:
        """The layout with ``counts`` channels; without any, the default for each of ``phalanges``."""
        return cls(tuple(map(int, counts)) or (DEFAULT_CHANNELS,) * phalanges)

    @classmethod
    def default(cls, size: int) -> ChannelLayout:
        """The layout of a strain vector of ``size`` elements with the default channels per phalanx."""
        return cls((DEFAULT_CHANNELS,) * (size // DEFAULT_CHANNELS))

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
    def slices(self) -> tuple[slice, ...]:
        """The elements of each phalanx."""
        ends = np.cumsum(self.counts).tolist()
        return tuple(slice(end - count, end) for end, count in zip(ends, self.counts, strict=True))

    @cached_property
    def phalanx(self) -> np.ndarray:
        """Index of the phalanx that each element belongs to, (C,) int."""
        return np.repeat(np.arange(self.phalanges), self.counts)

    @cached_property
    def _uniform(self) -> int:
        """Channels per phalanx where all have as many; 0 where they differ."""
        return self.counts[0] if len(set(self.counts)) == 1 else 0

    @cached_property
    def _starts(self) -> np.ndarray:
        return np.array([own.start for own in self.slices])

    def expand(self, values: np.ndarray) -> np.ndarray:
        """One value per phalanx, (..., F), as one per channel, (..., C)."""
        return np.asarray(values)[..., self.phalanx]

    def split(self, values: np.ndarray) -> list[np.ndarray]:
        """Values (..., C) by phalanx: F arrays (..., channels of the phalanx)."""
        return [values[..., own] for own in self.slices]

    def sum(self, values: np.ndarray) -> np.ndarray:
        """Sums over the channels of each phalanx, (..., C) to (..., F)."""
        if self._uniform:
            return np.asarray(self._reshaped(values).sum(axis=-1))
        return np.add.reduceat(values, self._starts, axis=-1)

    def all(self, flags: np.ndarray) -> np.ndarray:
        """Whether the flags of all channels of each phalanx are set, (..., C) to (..., F) bool."""
        if self._uniform:
            return np.asarray(self._reshaped(flags).all(axis=-1))
        return np.logical_and.reduceat(flags, self._starts, axis=-1)

    def min(self, values: np.ndarray) -> np.ndarray:
        """Least value of the channels of each phalanx, (..., C) to (..., F)."""
        return np.minimum.reduceat(values, self._starts, axis=-1)

    def place(self, element: int) -> tuple[int, int]:
        """Index of the phalanx of an element of the strain vector, and its channel there, from 1."""
        phalanx = int(self.phalanx[element])
        return phalanx, element - self.slices[phalanx].start + 1

    def _reshaped(self, values: np.ndarray) -> np.ndarray:
        return values.reshape(*values.shape[:-1], self.phalanges, self._uniform)
