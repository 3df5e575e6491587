"""Recordings: strain and palm positions by sweep, the common form of CSV files, bags and scans.

Import, replay and evaluation work on a :class:`Recording` and do not depend on its source.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import ScanError, counted
from tactile_localizer.io.status import FAULT, MISSING, OK, SATURATED
from tactile_localizer.scene import LARGEST_STRAIN, Axis, Scene
from tactile_localizer.streams.arrivals import Seen
from tactile_localizer.streams.delay import Delay, Track, estimate_delay
from tactile_localizer.streams.findings import findings
from tactile_localizer.streams.runs import LATE, NANOSECONDS, rows_at
from tactile_localizer.streams.sweep_detector import NO_SWEEP, SweepDetector
from tactile_localizer.streams.synchronization import DEFAULT_MAX_GAP_S, interpolate_poses

_Sweep = TypeVar("_Sweep", bound=Any)

NO_CONTACT = (-1, -1)
ENDED = "ended"
ENDED_EARLY = "ended early"
"""Ending of a sweep whose recording was interrupted."""


@dataclass(frozen=True)
class RecordedSweep:
    """Samples of one sweep, in the order of their stamps.

    Parameters
    ----------
    number : the sweep's number in its source
    stamp_ns : (n,) int64 stamps, ns
    position : (n, d) measured palm positions, m (yaw: rad)
    strain : (n, C) strain voltages, V; NaN where missing
    status : (n, F) uint8 status bits, one per phalanx
    truth : (n, d) true palm positions, if known independently of ``position``
    gaps : strain samples skipped because no pose was close enough in time
    felt : (n,) bool, whether the hand feels a feature above the noise, where that is known
    skipped : strain samples that were missing, saturated or out of bounds, and are not in the scan
    ending : :data:`ENDED`, or :data:`ENDED_EARLY`
    strain_unit : for display
    """

    number: int
    stamp_ns: np.ndarray
    position: np.ndarray
    strain: np.ndarray
    status: np.ndarray
    truth: np.ndarray | None = None
    gaps: int = 0
    felt: np.ndarray | None = None
    skipped: int = 0
    ending: str = ENDED
    strain_unit: str = "V"

    @property
    def contact(self) -> tuple[int, int]:
        """First and last sample in contact with a feature; -1: no contact."""
        if self.felt is None or not self.felt.any():
            return NO_CONTACT
        at = np.flatnonzero(self.felt)
        return int(at[0]), int(at[-1])

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def __repr__(self) -> str:
        """One line, without the arrays."""
        return f"<RecordedSweep {self.number} of {counted(len(self), 'sample')}>"

    def samples(self) -> Iterator[tuple[int, np.ndarray, np.ndarray, np.ndarray]]:
        """Stamp, position, strain and usable phalanges of each sample, as :meth:`.Localizer.update` takes."""
        return zip(self.stamp_ns.tolist(), self.position, self.strain, usable(self.status), strict=True)

    def part(self, rows: slice | np.ndarray, number: int, gaps: int = 0) -> RecordedSweep:
        """A subset of the samples, (n,) bool or a slice, as a separate sweep."""
        arrays: dict[str, Any] = {
            name: each[rows] for name, each in vars(self).items() if isinstance(each, np.ndarray)
        }
        return replace(self, **arrays, number=number, gaps=gaps)


@dataclass(frozen=True)
class Recording:
    """Sweeps over one piece of material.

    Parameters
    ----------
    source : path of the source, for messages
    sweeps : in the order of the source, with the axes and phalanges of the scene that it was read for
    notes : one line for each part of the source that was skipped
    lost : number of samples of the source that could not be read; the notes say why
    sessions : numbers of the sweeps with which its sessions begin; empty: one session
    """

    source: str
    sweeps: tuple[RecordedSweep, ...]
    notes: tuple[str, ...] = ()
    lost: int = 0
    sessions: tuple[int, ...] = ()

    def __len__(self) -> int:
        return sum(map(len, self.sweeps))

    def __repr__(self) -> str:
        """One line, without the sweeps."""
        samples, sweeps = counted(len(self), "sample"), counted(len(self.sweeps), "sweep")
        return f"<Recording {self.source} of {samples} in {sweeps}>"


def join(recordings: Sequence[Recording]) -> Recording:
    """Concatenate the sweeps of recordings; a sweep whose number is in use gets the next free number.

    Each is a session, unless one of them is a single sweep: then they may be the strokes of one.

    Parameters
    ----------
    recordings : at least one, all with the same axes, phalanges and channels
    """
    sweeps = numbered_apart(sweep for recording in recordings for sweep in recording.sweeps)
    counts = [len(recording.sweeps) for recording in recordings]
    begins = np.cumsum([0, *counts[:-1]]).tolist() if len(counts) > 1 and min(counts) > 1 else []
    return Recording(
        source=", ".join(recording.source for recording in recordings),
        sweeps=tuple(sweeps),
        notes=tuple(note for recording in recordings for note in recording.notes),
        lost=sum(recording.lost for recording in recordings),
        sessions=tuple(sweeps[first].number for first in begins),
    )


def numbered_apart(sweeps: Iterable[_Sweep]) -> list[_Sweep]:
    """Sweeps, recorded or replayed; one whose number is in use gets the next free number."""
    found: dict[int, _Sweep] = {}
    largest = 0
    for sweep in sweeps:
        number = largest + 1 if sweep.number in found else sweep.number
        found[number], largest = replace(sweep, number=number), max(largest, number)
    return list(found.values())


def cut(samples: RecordedSweep, run: np.ndarray, number: np.ndarray) -> list[RecordedSweep]:
    """The sweeps of samples, each within a run; its samples without a position are gaps.

    Parameters
    ----------
    samples : n samples in the order of arrival or of the rows of a file
    run : (n,) int, their run, or :data:`LATE`
    number : (n,) int, their sweep, or :data:`NO_SWEEP`
    """
    rows, known = np.flatnonzero(run != LATE), np.isfinite(samples.position).all(axis=1)
    ends = np.flatnonzero((np.diff(run[rows]) != 0) | (np.diff(number[rows]) != 0)) + 1
    return [
        samples.part(_slice(part[known[part]]), int(number[part[0]]), int(np.sum(~known[part])))
        for part in np.split(rows, ends)
        if len(part) and number[part[0]] != NO_SWEEP
    ]


def cut_rows(
    what: str,
    samples: RecordedSweep,
    run: np.ndarray,
    number: np.ndarray,
    detector: SweepDetector | None = None,
) -> tuple[list[RecordedSweep], list[str]]:
    """The sweeps of the rows of a file, and lines about rows, called ``what``, that are in none.

    Arguments as of :func:`cut`; ``detector`` detects other sweeps in the motion, within each run and sweep.
    """
    rows, notes = np.flatnonzero(run != LATE), list[str]()
    if detector is not None:
        parts = zip(run[rows].tolist(), number[rows].tolist(), strict=True)
        number = number.copy()
        number[rows] = detector.update_all(samples.stamp_ns[rows], samples.position[rows], parts)
        notes = detection_notes(number[rows])
    return cut(samples, run, number), [*notes, *row_notes(what, run)]


def row_notes(what: str, run: np.ndarray) -> Iterator[str]:
    """Lines about rows of a file, called ``what``, in runs (n,), whose stamps do not increase."""
    in_order = run[run != LATE]
    jumps = int(np.count_nonzero(np.diff(in_order) > 0))
    return stamp_notes(what, len(run), len(run) - len(in_order), jumps)


def detection_notes(number: np.ndarray) -> list[str]:
    """A line about samples (n,) that are in no detected sweep."""
    outside = int(np.sum(number == NO_SWEEP))
    return [f"{outside} of {len(number)} samples are in no detected sweep"] * (outside > 0)


def undelayed(
    recording: Recording, axes: tuple[Axis, ...], delay_s: float, max_gap_s: float = DEFAULT_MAX_GAP_S
) -> Recording:
    """A recording whose only poses are those of its samples, with the positions where late strain was felt.

    Parameters
    ----------
    axes : of the recording
    delay_s : time by which the strain is late, s
    max_gap_s : longest time between two samples across which positions are interpolated, s
    """
    if not delay_s:
        return recording
    sweeps: list[RecordedSweep] = []
    for run in _runs_of_sweeps(recording.sweeps):
        samples = _joined(run)
        felt_ns = samples.stamp_ns - round(delay_s * NANOSECONDS)
        at_felt = partial(interpolate_poses, axes, samples.stamp_ns, stamp_ns=felt_ns, max_gap_s=max_gap_s)
        truth = None if samples.truth is None else at_felt(samples.truth)[0]
        felt = replace(samples, stamp_ns=felt_ns, position=at_felt(samples.position)[0], truth=truth)
        row = np.repeat(np.arange(len(run)), [len(each) for each in run])
        row = row[rows_at(samples.stamp_ns, felt_ns)]
        for part in cut(felt, np.zeros_like(row), row):
            own = run[part.number]
            gaps = own.gaps + part.gaps
            sweeps.append(replace(part, number=own.number, gaps=gaps, skipped=own.skipped, ending=own.ending))
    return replace(recording, sweeps=tuple(sweeps))


def _joined(run: Sequence[RecordedSweep]) -> RecordedSweep:
    """The samples of sweeps as one, with the arrays that all of them have."""
    columns = {name: [getattr(each, name) for each in run] for name in vars(run[0])}
    is_array = {name: {*map(type, each)} == {np.ndarray} for name, each in columns.items()}
    arrays: dict[str, Any] = {name: np.concatenate(columns[name]) for name in columns if is_array[name]}
    return replace(run[0], **{"truth": None, "felt": None, **arrays})


def _runs_of_sweeps(sweeps: Sequence[RecordedSweep]) -> Iterator[list[RecordedSweep]]:
    """Successive sweeps whose stamps go on rising; those without samples are left out."""
    run: list[RecordedSweep] = []
    for sweep in filter(len, sweeps):
        if run and sweep.stamp_ns[0] <= run[-1].stamp_ns[-1]:
            yield run
            run = []
        run.append(sweep)
    if run:
        yield run


def delay_of(recording: Recording, axes: tuple[Axis, ...]) -> Delay | None:
    """How late the strain of a recording is; see :func:`~tactile_localizer.streams.delay.estimate_delay`."""
    tracks = [Track(each.stamp_ns, each.position, each.strain) for each in recording.sweeps if len(each)]
    return estimate_delay(axes, tracks) if tracks else None


def _slice(rows: np.ndarray) -> slice | np.ndarray:
    """Rising ``rows`` without a gap as a slice, which copies nothing."""
    is_whole = len(rows) > 0 and rows[-1] - rows[0] == len(rows) - 1
    return slice(int(rows[0]), int(rows[-1]) + 1) if is_whole else rows


def gap_notes(recording: Recording) -> list[str]:
    """A line about samples that are left out because no pose was close enough in time."""
    gaps = sum(sweep.gaps for sweep in recording.sweeps)
    found = f"skipped {gaps} of {len(recording) + gaps} samples without a palm pose close enough in time"
    return [found] * bool(gaps)


def unusable(recording: Recording, notes: Sequence[str], expected: str) -> ScanError:
    """Refusal of a recording, in a line that names its file once: the notes, and what was expected."""
    own = f"{recording.source}: "
    return ScanError(own + "; ".join((*notes, expected)).replace(own, ""))


def scan_of(recording: Recording, scene: Scene) -> Scan:
    """The samples of all sweeps as training pairs, in the order of the sweeps; ``scene`` names the columns.

    Raises
    ------
    ScanError
        There are none.
    """
    if not len(recording):
        raise ScanError(f"{recording.source}: expected at least one state-measurement pair, found none")
    sweeps = recording.sweeps
    return Scan(
        states=np.concatenate([sweep.position for sweep in sweeps]),
        strain=np.concatenate([sweep.strain for sweep in sweeps]),
        sweep=np.repeat([sweep.number for sweep in sweeps], [len(sweep) for sweep in sweeps]),
        axes=scene.axis_names,
        phalanges=scene.phalanx_names,
        channels=scene.layout.counts,
        sessions=recording.sessions,
    )


def sharing(recording: Recording, scan: Scan) -> Recording:
    """A recording whose pairs are those of its scan (:func:`scan_of`), so that they are in memory once."""
    ends = np.cumsum([0, *map(len, recording.sweeps)])
    each = zip(recording.sweeps, pairwise(ends.tolist()), strict=True)
    sweeps = [replace(one, position=scan.states[a:b], strain=scan.strain[a:b]) for one, (a, b) in each]
    return replace(recording, sweeps=tuple(sweeps))


def stamp_notes(what: str, count: int, late: int, jumps: int) -> Iterator[str]:
    """Lines about ``count`` samples, called ``what``, of which some are late, and some jump back."""
    if late:
        yield f"skipped {late} of {count} {what} whose stamps do not increase"
    if jumps:
        yield f"{jumps} of {count} {what} have stamps that jump back: another run begins"


def pose_notes(what: str, seen: Seen, shift: Callable[[float], str] = lambda ahead_s: "") -> Iterator[str]:
    """Findings about poses of a source, for the lines; ``shift`` advises where their clock is ahead by s."""
    for found in findings(seen):
        yield f"{what}: {found.text}" + (shift(found.value) if found.name == "difference" else "")


def usable(status: np.ndarray) -> np.ndarray:
    """Phalanges that a filter may use: those whose status is OK.

    Parameters
    ----------
    status : (..., F) status bits

    Returns
    -------
    (..., F) bool
    """
    return status == OK


USABLE = 0
OUTSIDE = 8
"""The palm is outside the scene's bounds; differs from all status bits."""


def screen(scene: Scene, position: np.ndarray, strain: np.ndarray, status: np.ndarray) -> np.ndarray:
    """Reasons why a scan cannot use samples, (n,) of ``MISSING``, ``SATURATED``, ``OUTSIDE``, or ``USABLE``.

    Of several reasons, the first in this order is given.

    Parameters
    ----------
    scene : axes with their bounds
    position : (n, d) palm positions, m (yaw: rad)
    strain : (n, C) strain voltages, V
    status : (n, F) status bits
    """
    # Implausibly large values count as missing. Comparisons with NaN are false.
    complete = (np.abs(strain) <= LARGEST_STRAIN).all(axis=1) & ~np.any(status & (MISSING | FAULT), axis=1)
    saturated = np.any(status & SATURATED, axis=1)
    # A position that is not finite counts as outside.
    inside = np.all((position >= scene.lower) & (position <= scene.upper), axis=1)
    return np.select([~complete, saturated, ~inside], [MISSING, SATURATED, OUTSIDE], USABLE)


BAG_EXTENSIONS = (".mcap", ".db3", ".mcap.zstd", ".db3.zstd")
SCENE_OF_SCAN = "scene.yaml"
"""File that makes a folder a scan."""


def is_scan(path: Path) -> bool:
    """Whether a path is a scan: a folder with a scene."""
    return os.path.isfile(path / SCENE_OF_SCAN)  # noqa: PTH113  false without permission, too
