"""Scene: the axes of the state, the phalanges, the region of the feature and the motion noise.

:mod:`tactile_localizer.io.scene_file` reads and writes scenes as YAML.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tactile_localizer.channels import DEFAULT_CHANNELS, ChannelLayout
from tactile_localizer.errors import SceneError
from tactile_localizer.quantity import number

AXIS_NAMES = ("x", "y", "yaw")
"""Axes that a scene may name, m, m and rad: the palm's position relative to the material."""

DEFAULT_MOTION_STD = 0.003
"""Default standard deviation of the motion noise after 1 m of travel, m or rad."""

LARGEST_POSITION = 1e3
"""Largest valid position, bound or offset, m or rad; others indicate damage or a wrong unit."""

SMALLEST_EXTENT = 1e-6
"""Least distance between the bounds of an axis, m or rad."""

FULL_TURN_TOLERANCE = 1e-4
"""Difference to 2 pi up to which a range of yaw is a full turn, rad: bounds of [-3.1416, 3.1416]."""

MOST_PHALANGES = 100
"""Largest number of phalanges of a scene."""

LARGEST_STRAIN = 1e10
"""Largest valid strain, V or counts: more than a 32-bit converter can produce."""

MOST_CELLS = 1_000_000
"""Largest number of cells that cover the bounds: a sheet of 2 m by 0.5 m at 1 mm, whose tables take 2 GB."""

MOST_CHANNELS = 4096
"""Largest number of channels of a phalanx."""


@dataclass(frozen=True)
class Axis:
    """One axis of the state.

    Parameters
    ----------
    name : one of :data:`AXIS_NAMES`
    lower, upper : bounds of the palm's position, m (``yaw``: rad)
    motion_std : standard deviation of the motion noise after 1 m of travel, m (``yaw``: rad); its variance
        is proportional to the travel
    """

    name: str
    lower: float
    upper: float
    motion_std: float = DEFAULT_MOTION_STD

    def __post_init__(self) -> None:
        if self.name not in AXIS_NAMES:
            raise SceneError(f"axis {self.name!r}: expected one of {', '.join(AXIS_NAMES)}")
        for bound in (self.lower, self.upper):
            _checked(bound, f"axis {self.name} bounds")
        _checked(self.motion_std, f"axis {self.name} motion_std", lower=0.0)
        if self.extent < SMALLEST_EXTENT:
            raise SceneError(
                f"axis {self.name}: expected bounds [lower, upper] at least {SMALLEST_EXTENT:g} apart, "
                f"got [{self.lower}, {self.upper}]"
            )
        if self.name == "yaw" and (
            self.extent > 2 * math.pi + FULL_TURN_TOLERANCE
            or (self.wraps and abs(self.lower + math.pi) > FULL_TURN_TOLERANCE)
        ):
            raise SceneError(
                f"axis yaw: expected at most a full turn, [-3.1416, 3.1416], got [{self.lower}, {self.upper}]"
            )

    @property
    def extent(self) -> float:
        """Length of the axis, m (``yaw``: rad)."""
        return self.upper - self.lower

    @property
    def wraps(self) -> bool:
        """Whether the axis is a full turn, so that its ends are the same place."""
        return self.name == "yaw" and self.extent >= 2 * math.pi - FULL_TURN_TOLERANCE


@dataclass(frozen=True)
class Phalanx:
    """A tactile sensor and its place on the hand.

    Parameters
    ----------
    name : in messages and files
    offset : in the palm's frame, on each axis of the scene, m (``yaw``: rad)
    channels : number of values per measurement
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
    """Axis-aligned box of phalanx positions in which the phalanx can touch the feature (the paper's Gamma).

    ``lower`` and ``upper`` have one entry per axis, which may be infinite.
    """

    lower: tuple[float, ...]
    upper: tuple[float, ...]

    def contains(self, positions: np.ndarray) -> np.ndarray:
        """Whether phalanx positions (N, d) are in the region: (N,) bool."""
        inside = np.ones(len(positions), dtype=bool)
        # One axis at a time, because a reduction over two or three columns is slow.
        for coordinates, low, high in zip(positions.T, self.lower, self.upper, strict=True):
            inside &= (coordinates >= low) & (coordinates <= high)
        return inside


@dataclass(frozen=True)
class Scene:
    """Axes, phalanges and feature of a localization problem.

    Parameters
    ----------
    name : in files and messages
    axes : one to three axes, in the order of the state vector
    phalanges : the tactile sensors in use, in the order of the strain vector
    feature : region of the feature, in phalanx positions; ``None``: not known
    """

    name: str
    axes: tuple[Axis, ...]
    phalanges: tuple[Phalanx, ...]
    feature: Region | None = None

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
            if len(phalanx.offset) != d:
                raise SceneError(f"phalanx {phalanx.name}: expected {d} offsets, got {phalanx.offset}")
            for axis, offset in zip(self.axes, phalanx.offset, strict=True):
                _checked(offset, f"phalanx {phalanx.name} offset {axis.name}")
        if self.feature is not None:
            self._check_feature(self.feature)

    def _check_feature(self, feature: Region) -> None:
        if not len(feature.lower) == len(feature.upper) == len(self.axes):
            raise SceneError(
                f"scene {self.name}: expected a feature region of {len(self.axes)} axes, got {feature}"
            )
        for axis, low, high in zip(self.axes, feature.lower, feature.upper, strict=True):
            for limit in (low, high):
                number(limit, f"feature {axis.name}", finite=False, error=SceneError)
            if not low < high:
                raise SceneError(f"feature {axis.name}: expected lower < upper, got [{low}, {high}]")

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
        """Channels of the strain vector by phalanx."""
        return ChannelLayout(tuple(phalanx.channels for phalanx in self.phalanges))

    @property
    def lower(self) -> np.ndarray:
        """Lower bounds, (d,)."""
        return np.array([axis.lower for axis in self.axes], dtype=np.float64)

    @property
    def upper(self) -> np.ndarray:
        """Upper bounds, (d,)."""
        return np.array([axis.upper for axis in self.axes], dtype=np.float64)

    @property
    def extent(self) -> np.ndarray:
        """Lengths of the axes, (d,)."""
        return self.upper - self.lower

    @property
    def motion_std(self) -> np.ndarray:
        """Standard deviation of the motion noise after 1 m of travel, (d,), m (yaw: rad)."""
        return np.array([axis.motion_std for axis in self.axes], dtype=np.float64)

    @property
    def wraps(self) -> np.ndarray:
        """Whether each axis is a full turn, (d,) bool."""
        return np.array([axis.wraps for axis in self.axes])

    def cells(self, size: np.ndarray | float, most: int = MOST_CELLS) -> np.ndarray:
        """Number of cells along each axis, (d,) int, that cover the bounds; call it before allocating them.

        Parameters
        ----------
        size : largest size of a cell, m (yaw: rad), of all axes or (d,)
        most : largest number of cells in all

        Raises
        ------
        SceneError
            There would be more.
        """
        counts = np.maximum(np.ceil(self.extent / size - 1e-9), 1.0)
        if float(np.prod(counts)) > most:
            bounds = ", ".join(f"{axis.name} {axis.lower:g} to {axis.upper:g}" for axis in self.axes)
            raise SceneError(
                f"scene {self.name}: expected at most {most:,} cells, got {np.prod(counts):,.0f} for the "
                f"bounds {bounds} in m (in mm?)"
            )
        return counts.astype(int)

    def columns(self, names: tuple[str, ...]) -> np.ndarray:
        """Indices (d,) of this scene's axes among the axes ``names``.

        Raises
        ------
        SceneError
            The scene names an axis that is not among them.
        """
        return self._indices("axis", self.axis_names, names)

    def rows(self, names: tuple[str, ...]) -> np.ndarray:
        """Indices (F,) of this scene's phalanges among the phalanges ``names``.

        Raises
        ------
        SceneError
            The scene names a phalanx that is not among them.
        """
        return self._indices("phalanx", self.phalanx_names, names)

    def _indices(self, kind: str, own: tuple[str, ...], names: tuple[str, ...]) -> np.ndarray:
        for name in own:
            if name not in names:
                raise SceneError(
                    f"{kind} {name!r} of scene {self.name!r}: expected one of {', '.join(names)}"
                )
        return np.array([names.index(name) for name in own], dtype=np.intp)

    def channels(self, names: tuple[str, ...], counts: Sequence[int] = ()) -> np.ndarray:
        """Indices (C,) of this scene's channels in a strain vector of other phalanges.

        Parameters
        ----------
        names : phalanges of the strain vector
        counts : number of channels of each; empty: the default for each

        Raises
        ------
        SceneError
            The strain vector lacks a phalanx of the scene, or has another number of channels for it.
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


def _checked(value: float, what: str, lower: float = -LARGEST_POSITION) -> None:
    number(value, what, lower=lower, upper=LARGEST_POSITION, error=SceneError)


def _require_unique(kind: str, names: list[str]) -> None:
    for name in names:
        if names.count(name) > 1:
            raise SceneError(f"{kind} {name!r}: expected once, found {names.count(name)} times")
