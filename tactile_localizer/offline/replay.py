"""Replay of a recording through the localizer that runs live, as fast as the machine allows.

The localizer receives stamps, positions and strains exactly as from the filter node, and starts each sweep
from a uniform prior.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.decision.convergence import State
from tactile_localizer.core.likelihood.kernel_position import KernelPosition
from tactile_localizer.core.likelihood.sweep_mixture import SweepMixture
from tactile_localizer.core.localizer import Coasting, Estimate, Localizer
from tactile_localizer.errors import MeasurementError
from tactile_localizer.io.recording import NO_CONTACT, RecordedSweep, Recording, usable
from tactile_localizer.offline.odometry import travelled
from tactile_localizer.scene import Scene

Progress = Callable[[str, float], None]

_REPORT_EVERY = 500
_AT_ONCE = 64
"""Samples without an update that are taken in together: more than there usually are between two updates."""
_LARGEST = 1e90
"""Numbers beyond this are left to the localizer to refuse."""
_TRAVEL = 3
"""Column of the travel among the numbers of :class:`_Estimates`."""


@dataclass(frozen=True)
class Track:
    """Estimates along one sweep, an entry for each of its n strains that could be used.

    Parameters
    ----------
    number : of the sweep
    row : (n,) int, which sample of the recorded sweep each entry belongs to
    stamp_ns : (n,) int64
    mean, covariance : (n, d) and (n, d, d), m (yaw: rad)
    state : n states of convergence
    probability : (n,) probability that the palm is on the map and near the estimate
    on_map : (n,) probability that it is on the map
    log_marginal : (n,) nats
    updated : (n,) bool, whether the strain led to a measurement update
    moved : (n,) m, travel that the localizer has counted
    consistent : (n, F) bool, phalanges that are not stuck
    reason : n texts, the reason for each state
    truth : (n, d) or ``None``
    travel : (n,) m from the sweep's start, along the truth where all of it is known
    seconds : (n,) s, computing time of the localizer
    refused : strains that the localizer refused
    contact : rows of the recorded sweep at which the feature's contact begins and ends; -1: none, or unknown
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
        """Index of the first entry on contact; 0 where there is none."""
        first = self.contact[0]
        return min(int(np.searchsorted(self.row, first)), max(len(self) - 1, 0)) if first >= 0 else 0

    @property
    def on_contact(self) -> np.ndarray:
        """Which entries lie between contact and the feature's end, (n,) bool."""
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
    localizer : is reset before each sweep
    recording : of the localizer's scene; its positions are the odometry
    progress : called with a description of the work and the completed fraction
    clock : s, measures the computing time of the localizer
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


def mixture_of(localizer: Localizer) -> SweepMixture:
    """The sweep mixture of a localizer; a kernel model holds one for convergence."""
    model = localizer.model
    mixture = model.mixture if isinstance(model, KernelPosition) else model
    assert isinstance(mixture, SweepMixture)
    return mixture


def _localize(
    localizer: Localizer, sweep: RecordedSweep, estimates: _Estimates, clock: Callable[[], float]
) -> Iterator[int]:
    """Add the estimates of a sweep; yields rows that are done."""
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
        # What leads to no update is taken in many at a time, up to a strain that the localizer may refuse.
        while estimate is not None and row < len(sweep):
            until = row + _AT_ONCE
            if not regular[row:until].all():
                until = row + int(regular[row:until].argmin())
            began = clock()
            coasting = localizer.coast(stamps[row:until], sweep.position[row:until])
            count = len(coasting.travel)
            if count:
                estimates.extend(row, estimate, coasting, clock() - began)
            row += count
            if count < _AT_ONCE:
                break
        yield row


def _regular(sweep: RecordedSweep, present: np.ndarray, layout: ChannelLayout) -> np.ndarray:
    """Samples (n,) bool that the localizer refuses in no case: present phalanges and finite numbers."""
    felt = np.where(layout.expand(present), sweep.strain, 0.0)
    small = [(np.abs(values) < _LARGEST).all(axis=1) for values in (felt, sweep.position)]  # false for NaN
    return np.asarray(small[0] & small[1] & present.any(axis=1))


class _Estimates:
    """Estimates along a sweep of at most ``count`` samples, as arrays: an hour has a million of them."""

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
        """Add the estimate of a sample, and how long it took."""
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
        """Add those of the samples from ``row`` on that led to no update, and how long all of them took."""
        begin, count = self._count, len(coasting.travel)
        part = slice(begin, begin + count)
        self._row[part] = np.arange(row, row + count)
        self._mean[part], self._covariance[part] = coasting.mean, coasting.covariance
        self._numbers[part] = (last.probability, last.on_map, last.log_marginal, 0.0, seconds / count)
        self._numbers[part, _TRAVEL] = coasting.travel
        self._updated[part], self._consistent[part] = False, last.consistent
        self._state += [last.state] * count
        self._reason += [last.reason] * count
        self._count += count

    def track(self, sweep: RecordedSweep) -> Track:
        """The estimates of ``sweep``."""
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
