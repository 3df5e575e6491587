"""What is modelled: the state's axes, the phalanges that feel, the feature's region, the motion's noise.

A model contains only the axes, phalanges and region that the scene names.
Reading and writing scenes as YAML is :mod:`tactile_localizer.io.scene_file`'s.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from tactile_localizer.channels import DEFAULT_CHANNELS, ChannelLayout
from tactile_localizer.errors import SceneError

AXIS_NAMES = ("x", "y", "yaw")
"""Axes that a scene may name: metres, metres, radians; palm relative to the material."""

DEFAULT_MOTION_STD = 0.003
"""m (or rad) of unknown motion, one sigma, after 1 m of travel, where a scene gives none."""

LARGEST_POSITION = 1e3
"""m or rad: positions, bounds and offsets beyond this are taken for damage or a wrong unit and refused."""

SMALLEST_EXTENT = 1e-6
"""m or rad: least distance between an axis's bounds."""

MOST_PHALANGES = 100
"""Phalanges that a scene may have: more than any hand."""

LARGEST_STRAIN = 1e10
"""V, or the strain's own unit: more than the counts of a 32-bit converter. Beyond it values are refused."""

MOST_CHANNELS = 4096
"""Channels that a phalanx may have: more than any tactile array has."""

FLOAT = np.float64


@dataclass(frozen=True)
class Axis:
    """One axis of the state.

    Parameters
    ----------
    name : one of :data:`AXIS_NAMES`
    lower, upper : bounds of the palm's position, m (``yaw``: rad)
    motion_std : one sigma of the unknown motion after 1 m of travel, m (``yaw``: rad). The variance
        grows in proportion to the travel, so the sample rate does not matter.
    """

    name: str
    lower: float
    upper: float
    motion_std: float = DEFAULT_MOTION_STD

    def __post_init__(self) -> None:
        if self.name not in AXIS_NAMES:
            raise SceneError(f"axis {self.name!r}: expected one of {', '.join(AXIS_NAMES)}")
        if not (math.isfinite(self.lower) and math.isfinite(self.upper) and self.lower < self.upper):
            raise SceneError(
                f"axis {self.name}: expected finite bounds with lower < upper, "
                f"got [{self.lower}, {self.upper}]"
            )
        if self.name == "yaw" and (
            self.extent > 2 * math.pi + 1e-9 or (self.wraps and abs(self.lower + math.pi) > 1e-9)
        ):
            raise SceneError(
                f"axis yaw: expected at most a full turn, [-pi, pi], got [{self.lower}, {self.upper}]"
            )
        if not (math.isfinite(self.motion_std) and self.motion_std >= 0):
            raise SceneError(f"axis {self.name}: expected motion_std >= 0, got {self.motion_std}")
        if max(abs(self.lower), abs(self.upper), self.motion_std) > LARGEST_POSITION:
            raise SceneError(
                f"axis {self.name}: expected at most {LARGEST_POSITION:g} m or rad, "
                f"got [{self.lower}, {self.upper}] and motion_std {self.motion_std}"
            )
        if self.extent < SMALLEST_EXTENT:
            raise SceneError(
                f"axis {self.name}: expected bounds at least {SMALLEST_EXTENT:g} apart, "
                f"got [{self.lower}, {self.upper}]"
            )

    @property
    def extent(self) -> float:
        """Length of the axis, m (``yaw``: rad)."""
        return self.upper - self.lower

    @property
    def wraps(self) -> bool:
        """Whether the axis is a full turn, so that its two ends are the same place."""
        return self.name == "yaw" and self.extent >= 2 * math.pi - 1e-9


@dataclass(frozen=True)
class Phalanx:
    """A tactile sensor and where it sits.

    Parameters
    ----------
    name : what messages and files call it
    offset : in the palm's frame on each axis of the scene, m (``yaw``: rad); it turns with the palm's yaw
    channels : values that the sensor gives at a time
    """

    name: str
    offset: tuple[float, ...]
    channels: int = DEFAULT_CHANNELS

    def __post_init__(self) -> None:
        if not 1 <= self.channels <= MOST_CHANNELS:
            raise SceneError(
                f"phalanx {self.name}: expected 1 to {MOST_CHANNELS} channels, got {self.channels}"
            )


@dataclass(frozen=True)
class Region:
    """An axis-aligned box in a phalanx's coordinates (the paper's Gamma): where it can touch the feature.

    ``lower`` and ``upper`` have one entry an axis; infinite where the region has no limit.
    """

    lower: tuple[float, ...]
    upper: tuple[float, ...]

    def contains(self, positions: np.ndarray) -> np.ndarray:
        """Which of ``positions`` (N, d), in phalanx coordinates, lie in the region: (N,) bool."""
        inside = np.ones(len(positions), dtype=bool)
        # An axis at a time: a reduction over two or three columns is slow.
        for coordinates, low, high in zip(positions.T, self.lower, self.upper, strict=True):
            inside &= (coordinates >= low) & (coordinates <= high)
        return inside


@dataclass(frozen=True)
class Scene:
    """Everything that is modelled.

    Parameters
    ----------
    name : what the scene is called in files and messages
    axes : one to three axes, in the order of the state vector
    phalanges : the tactile sensors in use, in the order of the strain vector
    feature : the region of the feature, in phalanx coordinates; ``None``: not known
    measurement : parameters of the measurement model, by name; missing ones are chosen from the
        scan by leave-one-sweep-out prediction
    """

    name: str
    axes: tuple[Axis, ...]
    phalanges: tuple[Phalanx, ...]
    feature: Region | None = None
    measurement: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not 1 <= len(self.axes) <= 3:
            raise SceneError(f"scene {self.name}: expected one to three axes, got {len(self.axes)}")
        _require_unique("axis", [axis.name for axis in self.axes])
        if not self.phalanges:
            raise SceneError(f"scene {self.name}: expected at least one phalanx, got none")
        if len(self.phalanges) > MOST_PHALANGES:
            raise SceneError(
                f"scene {self.name}: expected at most {MOST_PHALANGES} phalanges, got {len(self.phalanges)}"
            )
        _require_unique("phalanx", [phalanx.name for phalanx in self.phalanges])
        d = len(self.axes)
        for phalanx in self.phalanges:
            if len(phalanx.offset) != d or not np.all(np.abs(phalanx.offset) <= LARGEST_POSITION):
                raise SceneError(
                    f"phalanx {phalanx.name}: expected {d} offsets of at most {LARGEST_POSITION:g} m or rad, "
                    f"got {phalanx.offset}"
                )
        if self.feature is not None and not len(self.feature.lower) == len(self.feature.upper) == d:
            raise SceneError(f"scene {self.name}: expected a feature region of {d} axes, got {self.feature}")

    @property
    def dimension(self) -> int:
        """Number of axes, d."""
        return len(self.axes)

    @property
    def axis_names(self) -> tuple[str, ...]:
        """Names of the axes, in the order of the state vector."""
        return tuple(axis.name for axis in self.axes)

    @property
    def phalanx_names(self) -> tuple[str, ...]:
        """Names of the phalanges, in the order of the strain vector."""
        return tuple(phalanx.name for phalanx in self.phalanges)

    @cached_property
    def layout(self) -> ChannelLayout:
        """The elements of the strain vector by phalanx."""
        return ChannelLayout(tuple(phalanx.channels for phalanx in self.phalanges))

    @property
    def lower(self) -> np.ndarray:
        """Lower bounds, (d,)."""
        return np.array([axis.lower for axis in self.axes], dtype=FLOAT)

    @property
    def upper(self) -> np.ndarray:
        """Upper bounds, (d,)."""
        return np.array([axis.upper for axis in self.axes], dtype=FLOAT)

    @property
    def motion_std(self) -> np.ndarray:
        """Unknown motion after 1 m of travel, one sigma an axis, (d,)."""
        return np.array([axis.motion_std for axis in self.axes], dtype=FLOAT)

    @property
    def wraps(self) -> np.ndarray:
        """Which axes are full turns, (d,) bool."""
        return np.array([axis.wraps for axis in self.axes])

    def columns(self, names: tuple[str, ...]) -> np.ndarray:
        """Columns of this scene's axes in states on the axes ``names``, (d,) int.

        Raises
        ------
        SceneError
            The scene names an axis that the states do not have.
        """
        for axis in self.axis_names:
            if axis not in names:
                raise SceneError(f"axis {axis!r} of scene {self.name!r}: expected one of {', '.join(names)}")
        return np.array([names.index(axis) for axis in self.axis_names], dtype=np.intp)

    def rows(self, names: tuple[str, ...]) -> np.ndarray:
        """Places of this scene's phalanges among the phalanges ``names``, (F,) int.

        Raises
        ------
        SceneError
            The scene names a phalanx that is not among them.
        """
        for phalanx in self.phalanx_names:
            if phalanx not in names:
                raise SceneError(
                    f"phalanx {phalanx!r} of scene {self.name!r}: expected one of {', '.join(names)}"
                )
        return np.array([names.index(phalanx) for phalanx in self.phalanx_names], dtype=np.intp)

    def channels(self, names: tuple[str, ...], counts: Sequence[int] = ()) -> np.ndarray:
        """Columns of this scene's phalanges in a strain vector of the phalanges ``names``, (C,) int.

        Parameters
        ----------
        names : phalanges of the strain vector
        counts : channels of each of them; empty: the default for each

        Raises
        ------
        SceneError
            The scene names a phalanx that the strain vector does not have, or has with other channels.
        """
        layout = ChannelLayout.of(counts, len(names))
        columns: list[int] = []
        for phalanx, row in zip(self.phalanges, self.rows(names), strict=True):
            if layout.counts[row] != phalanx.channels:
                raise SceneError(
                    f"phalanx {phalanx.name!r} of scene {self.name!r}: expected {phalanx.channels} channels, "
                    f"got {layout.counts[row]}"
                )
            own = layout.slices[row]
            columns.extend(range(own.start, own.stop))
        return np.array(columns, dtype=np.intp)


def _require_unique(kind: str, names: list[str]) -> None:
    for name in names:
        if names.count(name) > 1:
            raise SceneError(f"{kind} {name!r}: expected once, found {names.count(name)} times")
