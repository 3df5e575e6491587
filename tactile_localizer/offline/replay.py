"""Replay of a recording through the localizer of the filter node, as fast as the machine allows.

The localizer receives stamps, positions and strain as it does live, and starts each sweep from a uniform
prior.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.decision.convergence import State
from tactile_localizer.core.localizer import Coasting, Estimate, Localizer
from tactile_localizer.errors import MeasurementError
from tactile_localizer.io.recording import NO_CONTACT, RecordedSweep, Recording, usable
from tactile_localizer.offline.odometry import travelled
from tactile_localizer.scene import Scene

Progress = Callable[[str, float], None]

_REPORT_EVERY = 500

_MAX_COASTING = 64
"""Most samples without a measurement update that are processed together; usually fewer are between two."""

_LARGEST = 1e90
"""Larger numbers are passed to :meth:`Localizer.update`, which decides whether to refuse them."""


@dataclass(frozen=True)
class Track:
    """Estimates along one sweep, one for each of the n samples that the localizer accepted.

    Parameters
    ----------
    number : number of the sweep
    row : (n,) int, index of the sample in the recorded sweep
    stamp_ns : (n,) int64 stamps, ns
    mean, covariance : (n, d) and (n, d, d), m (yaw: rad)
    state : n states of convergence
    probability : (n,) probability that the palm is on the map and near the estimate
    on_map : (n,) probability that the palm is on the map
    log_marginal : (n,) log marginal likelihood, nats
    updated : (n,) bool, whether the sample led to a measurement update
    moved : (n,) travel according to the localizer, m
    consistent : (n, F) bool, phalanges that are not stuck
    reason : n texts, the reason for each state
    truth : (n, d) true positions, or ``None``
    travel : (n,) travel from the start of the sweep, m, along the truth if all of it is known
    seconds : (n,) computing time of the localizer, s
    refused : number of samples that the localizer refused
    contact : first and last sample of the recorded sweep in contact with the feature; -1: none, or unknown
    """

    number: int
    row: np.ndarray
    stamp_ns: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray
    state: tuple[State, ...]
    probability: np.ndarray
    on_map: np.ndarray
    log_marginal: np.ndarray
    updated: np.ndarray
    moved: np.ndarray
    consistent: np.ndarray
    reason: tuple[str, ...]
    truth: np.ndarray | None
    travel: np.ndarray
    seconds: np.ndarray
    refused: int
    contact: tuple[int, int] = NO_CONTACT

    def __len__(self) -> int:
        return len(self.stamp_ns)

    @property
    def trace(self) -> np.ndarray:
        """Sum of the variances, (n,)."""
        return np.trace(self.covariance, axis1=1, axis2=2)

    @cached_property
    def converged(self) -> np.ndarray:
        """Whether the position has converged, (n,) bool."""
        return np.array([state is State.CONVERGED for state in self.state], dtype=bool)

    @property
    def start(self) -> int:
        """Index of the first estimate in contact; 0 if there is none."""
        first = self.contact[0]
        return min(int(np.searchsorted(self.row, first)), max(len(self) - 1, 0)) if first >= 0 else 0

    @property
    def on_contact(self) -> np.ndarray:
        """Whether each estimate is between contact and the end of the feature, (n,) bool."""
        first, last = self.contact
        return (self.row >= first) & (self.row <= last) & (first >= 0)


def replay(
    localizer: Localizer,
    recording: Recording,
    progress: Progress | None = None,
    clock: Callable[[], float] = time.perf_counter,
) -> list[Track]:
    """Localize each sweep of a recording from a uniform prior.

    Parameters
    ----------
    localizer : localizer, reset before each sweep
    recording : recording whose positions are the odometry, with the axes and phalanges of the localizer
    progress : called with a description of the work and the completed fraction
    clock : clock for the computing time of the localizer, s
    """
    tracks = []
    done, total = 0, max(len(recording), 1)
    for sweep in recording.sweeps:
        localizer.reset()
        estimates = _Estimates(localizer.scene, len(sweep))
        reported = -_REPORT_EVERY
        for row in _localize(localizer, sweep, estimates, clock):
            if progress is not None and row >= reported + _REPORT_EVERY:
                progress("replaying", (done + row) / total)
                reported = row
        done += len(sweep)
        tracks.append(estimates.track(sweep))
    if progress is not None:
        progress("replaying", 1.0)
    return tracks


def _localize(
    localizer: Localizer, sweep: RecordedSweep, estimates: _Estimates, clock: Callable[[], float]
) -> Iterator[int]:
    """Add the estimates of a sweep; yields the number of processed samples."""
    stamps, present = sweep.stamp_ns, usable(sweep.status)
    regular = _regular(sweep, present, localizer.scene.layout)
    row = 0
    while row < len(sweep):
        began = clock()
        try:
            estimate = localizer.update(
                int(stamps[row]), sweep.position[row], sweep.strain[row], present[row]
            )
        except MeasurementError:
            estimate = None
        if estimate is not None:
            estimates.append(row, estimate, clock() - began)
        row += 1
        # Samples that lead to no update are processed together, up to one that the localizer may refuse.
        while estimate is not None and row < len(sweep):
            until = row + _MAX_COASTING
            if not regular[row:until].all():
                until = row + int(regular[row:until].argmin())
            began = clock()
            coasting = localizer.coast(stamps[row:until], sweep.position[row:until])
            count = len(coasting.travel)
            if count:
                estimates.extend(row, estimate, coasting, clock() - began)
            row += count
            if count < _MAX_COASTING:
                break
        yield row


def _regular(sweep: RecordedSweep, present: np.ndarray, layout: ChannelLayout) -> np.ndarray:
    """Samples (n,) bool that the localizer cannot refuse: with a phalanx present, and finite numbers."""
    felt = np.where(layout.expand(present), sweep.strain, 0.0)
    small = [(np.abs(values) < _LARGEST).all(axis=1) for values in (felt, sweep.position)]  # false for NaN
    return np.asarray(small[0] & small[1] & present.any(axis=1))


class _Estimates:
    """Arrays of the estimates along a sweep of at most ``count`` samples; an hour has a million."""

    def __init__(self, scene: Scene, count: int) -> None:
        d = scene.dimension
        self._scene, self._count = scene, 0
        self._row = np.empty(count, dtype=np.intp)
        self._mean, self._covariance = np.empty((count, d)), np.empty((count, d, d))
        self._numbers = np.empty((count, 5))
        self._updated = np.empty(count, dtype=bool)
        self._consistent = np.empty((count, len(scene.phalanges)), dtype=bool)
        self._state: list[State] = []
        self._reason: list[str] = []

    def append(self, row: int, estimate: Estimate, seconds: float) -> None:
        """Add the estimate of a sample and its computing time."""
        n = self._count
        self._row[n] = row
        self._mean[n], self._covariance[n] = estimate.mean, estimate.covariance
        self._numbers[n] = (
            estimate.probability,
            estimate.on_map,
            estimate.log_marginal,
            estimate.travel,
            seconds,
        )
        self._updated[n], self._consistent[n] = estimate.updated, estimate.consistent
        self._state.append(estimate.state)
        self._reason.append(estimate.reason)
        self._count += 1

    def extend(self, row: int, last: Estimate, coasting: Coasting, seconds: float) -> None:
        """Add the estimates of the samples from ``row`` on without an update, and their computing time."""
        begin, count = self._count, len(coasting.travel)
        part = slice(begin, begin + count)
        self._row[part] = np.arange(row, row + count)
        self._mean[part], self._covariance[part] = coasting.mean, coasting.covariance
        self._numbers[part, :3] = last.probability, last.on_map, last.log_marginal
        self._numbers[part, 3] = coasting.travel
        self._numbers[part, 4] = seconds / count
        self._updated[part], self._consistent[part] = False, last.consistent
        self._state += [last.state] * count
        self._reason += [last.reason] * count
        self._count += count

    def track(self, sweep: RecordedSweep) -> Track:
        """Track of the estimates along ``sweep``."""
        n = self._count
        row = self._row[:n]
        probability, on_map, log_marginal, moved, seconds = self._numbers[:n].T.copy()
        reference = sweep.position
        if sweep.truth is not None and np.isfinite(sweep.truth).all():
            reference = sweep.truth
        return Track(
            number=sweep.number,
            row=row,
            stamp_ns=sweep.stamp_ns[row],
            mean=self._mean[:n],
            covariance=self._covariance[:n],
            state=tuple(self._state),
            probability=probability,
            on_map=on_map,
            log_marginal=log_marginal,
            updated=self._updated[:n],
            moved=moved,
            consistent=self._consistent[:n],
            reason=tuple(self._reason),
            truth=None if sweep.truth is None else sweep.truth[row],
            travel=travelled(self._scene, reference)[row],
            seconds=seconds,
            refused=len(sweep) - n,
            contact=sweep.contact,
        )
