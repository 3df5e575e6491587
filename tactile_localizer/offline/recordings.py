"""Replay of many recordings, each of them read by the process that replays it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.localizer import Localizer
from tactile_localizer.core.scan.range import ScanRange
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import ScanError
from tactile_localizer.io.recording import Recording, numbered_apart, unusable, usable
from tactile_localizer.io.scans.folder import ScanFolder
from tactile_localizer.io.scans.learned import ready_localizer
from tactile_localizer.offline.metrics import ContactMap, with_contact_on
from tactile_localizer.offline.replay import Progress, ReplayedSweep, replay
from tactile_localizer.scene import Scene

Read = Callable[[], tuple[Recording, str]]
"""Reads a recording whose positions are odometry, and the kind of the odometry."""
Make = Callable[[], Localizer]


@dataclass(frozen=True, eq=False)
class ReplayedRecording:
    """What is kept of one or more recordings that were replayed.

    Parameters
    ----------
    source : paths, for messages
    notes : one line for each part of the source that was skipped
    odometry : kind of the positions
    strain_unit : for display
    strains_outside, positions_outside : (n,) bool, samples out of the range of the scan
    spread : (s, F) spread of the strain in each sweep by the noise of the scan (:meth:`.ScanRange.spread`)
    sweeps : the estimates
    origin : for each sweep which of the recordings it is from, and which of its sweeps
    """

    source: str
    notes: tuple[str, ...]
    odometry: str
    strain_unit: str
    strains_outside: np.ndarray
    positions_outside: np.ndarray
    spread: np.ndarray
    sweeps: list[ReplayedSweep]
    origin: list[tuple[int, int]]


def replay_recording(
    read: Read, make: Make, contact: ContactMap | None, bounds: ScanRange, progress: Progress | None
) -> ReplayedRecording:
    """Read a recording and replay it.

    Parameters
    ----------
    read, make : the recording and the localizer
    contact : map that marks the samples in contact with a feature
    bounds : range of the scan
    progress : called with a description of the work and the completed fraction

    Raises
    ------
    ScanError
        No sample has a position and strain.
    """
    localizer = make()
    recording, odometry = read()
    scene, sweeps = localizer.scene, recording.sweeps
    if not any(usable(sweep.status).any() for sweep in sweeps):
        raise unusable(recording, recording.notes, "expected samples, found none that a filter can use")
    strains, positions = [np.zeros(0, dtype=bool)], [np.zeros(0, dtype=bool)]
    for sweep in sweeps:
        strains.append(bounds.strains_outside(sweep.strain, usable(sweep.status)))
        if sweep.truth is None:
            positions.append(bounds.positions_outside(sweep.position, sweep.position[:1].sum(axis=0)))
        else:
            outside = (sweep.truth < scene.lower) | (sweep.truth > scene.upper)
            positions.append((outside & ~scene.wraps).any(axis=1))
    return ReplayedRecording(
        recording.source,
        recording.notes,
        odometry,
        sweeps[0].strain_unit if sweeps else "V",
        np.concatenate(strains),
        np.concatenate(positions),
        np.array([bounds.spread(sweep.strain) for sweep in sweeps]),
        replay(localizer, with_contact_on(recording, contact), progress),
        [(0, place) for place in range(len(sweeps))],
    )


def joined(parts: Sequence[ReplayedRecording]) -> ReplayedRecording:
    """Several recordings as one, as :func:`~tactile_localizer.io.recording.join`.

    Raises
    ------
    ScanError
        The positions are odometry of different kinds.
    """
    for part in parts:
        if part.odometry != parts[0].odometry:
            raise ScanError(
                f"{part.source}: expected true positions beside the arm's in all or in none, found odometry "
                f"that is {part.odometry}, of {parts[0].source} {parts[0].odometry}"
            )
    return ReplayedRecording(
        ", ".join(part.source for part in parts),
        tuple(note for part in parts for note in part.notes),
        parts[0].odometry,
        parts[0].strain_unit,
        np.concatenate([part.strains_outside for part in parts]),
        np.concatenate([part.positions_outside for part in parts]),
        np.concatenate([part.spread for part in parts]),
        numbered_apart(sweep for part in parts for sweep in part.sweeps),
        [(number, place) for number, part in enumerate(parts) for _, place in part.origin],
    )


def load_pairs(scan_file: str | Path) -> Scan:
    """The pairs of the scan in a folder."""
    return ScanFolder(scan_file).load()


def build_from_folder(
    scan_file: str | Path, scene: Scene, configuration: Configuration, seed: int
) -> Localizer:
    """A localizer on the scan in a folder."""
    return ready_localizer(scan_file, scene, configuration, np.random.default_rng(seed)).localizer
