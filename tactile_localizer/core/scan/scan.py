"""The training scan as arrays of palm positions and strain vectors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.errors import ScanError
from tactile_localizer.scene import Scene


@dataclass(frozen=True)
class Scan:
    """State-measurement pairs D = {(x_n, z_n)} (paper, III-B), in the order of recording.

    Parameters
    ----------
    states : (N, d) palm positions relative to the material, m (yaw: rad)
    strain : (N, C) strain voltages, V, the channels of each phalanx in the order of ``phalanges``
    sweep : (N,) int, number of the sweep that each pair belongs to
    axes : names of the d axes
    phalanges : names of the F phalanges
    channels : number of channels of each phalanx, C in all; empty: the default for each
    sessions : numbers of the sweeps with which its sessions begin; empty: one session

    Raises
    ------
    ScanError
        Shapes that do not match, no pairs at all, or values that are not finite.
    """

    states: np.ndarray
    strain: np.ndarray
    sweep: np.ndarray
    axes: tuple[str, ...]
    phalanges: tuple[str, ...]
    channels: tuple[int, ...] = ()
    sessions: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        n = len(self.states)
        if n == 0:
            raise ScanError("scan: expected at least one state-measurement pair, found none")
        expected = {
            "states": (n, len(self.axes)),
            "strain": (n, self.layout.size),
            "sweep": (n,),
        }
        for name, shape in expected.items():
            found = getattr(self, name).shape
            if found != shape:
                raise ScanError(f"scan {name}: expected shape {shape}, got {found}")
        for name in ("states", "strain"):
            if not np.all(np.isfinite(getattr(self, name))):
                raise ScanError(f"scan {name}: expected finite values, found NaN or infinity")

    @cached_property
    def layout(self) -> ChannelLayout:
        """Channels of the strain vector by phalanx."""
        return ChannelLayout.of(self.channels, len(self.phalanges))

    def __len__(self) -> int:
        return len(self.states)

    def __repr__(self) -> str:
        """One line, without the arrays."""
        axes, phalanges = ", ".join(self.axes), ", ".join(self.phalanges)
        return (
            f"<Scan of {len(self)} pairs in {len(self.sweep_numbers)} sweeps along {axes}: "
            f"{phalanges}, {self.layout.size} channels>"
        )

    def select(self, keep: np.ndarray) -> Scan:
        """A scan of some of the pairs, by boolean mask or indices."""
        return replace(self, states=self.states[keep], strain=self.strain[keep], sweep=self.sweep[keep])

    @cached_property
    def sweep_numbers(self) -> np.ndarray:
        """Numbers of the sweeps, ascending, (S,)."""
        return np.unique(self.sweep)

    @property
    def session(self) -> np.ndarray:
        """Index (S,) of the session in which each sweep was recorded, by ascending number of the sweep."""
        return np.searchsorted(self.sessions, self.sweep_numbers, side="right")

    @cached_property
    def rows_by_sweep(self) -> list[np.ndarray]:
        """Rows of each sweep, in the order of their numbers."""
        order = np.argsort(self.sweep, kind="stable")
        return np.split(order, np.flatnonzero(np.diff(self.sweep[order])) + 1)

    def positions_on(self, scene: Scene) -> np.ndarray:
        """Positions (N, d) on the axes of a scene.

        Raises
        ------
        SceneError
            The scene names an axis that the scan does not have.
        """
        return columns_of(self.states, scene.columns(self.axes))

    def strain_on(self, scene: Scene) -> np.ndarray:
        """Strains (N, C) of the phalanges of a scene.

        Raises
        ------
        SceneError
            The scan lacks a phalanx of the scene, or has another number of channels for it.
        """
        return columns_of(self.strain, scene.channels(self.phalanges, self.channels))


def columns_of(array: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """The given columns; the array itself if they are all of them, so that a large scan is not copied."""
    return array if np.array_equal(columns, np.arange(array.shape[1])) else array[:, columns]
