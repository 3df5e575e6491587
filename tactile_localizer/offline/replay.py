"""Replay of a recording through the localizer of the filter node, as fast as the machine allows.

The localizer receives stamps, positions and strain as it does live, and starts each sweep from a uniform
prior.
"""

import contextlib
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tactile_localizer.core.hypotheses.convergence import ConvergenceCriteria, State
from tactile_localizer.core.localizer import Estimate, Localizer
from tactile_localizer.errors import MeasurementError
from tactile_localizer.io.recording import NO_CONTACT, RecordedSweep, Recording
from tactile_localizer.offline.odometry import travelled
from tactile_localizer.scene import Scene

Progress = Callable[[str, float], None]

_REPORT_EVERY = 500


@dataclass(frozen=True)
class ReplayedSweep:
    """Estimates along one sweep, one for each of the n samples that the localizer accepted.

    Parameters
    ----------
    scene : scene of the localizer
    criteria : its thresholds of convergence
    number : number of the sweep
    row : (n,) int, index of the sample in the recorded sweep
    stamp_ns : (n,) int64 stamps, ns
    mean, covariance : (n, d) and (n, d, d), m (yaw: rad)
    state : n states of convergence
    probability : (n,) probability that the palm is on the map and near the estimate
    on_map : (n,) probability that the palm is on the map
    log_marginal : (n,) log marginal likelihood, nats
    updated : (n,) bool, whether the sample led to a measurement update
    reason : n texts, the reason for each state
    truth : (n, d) true positions, or ``None``
    travel : (n,) travel from the start of the sweep, m, along the truth if all of it is known
    seconds : (n,) processor time of the localizer, s
    refused : number of samples that the localizer refused
    contact : first and last sample of the recorded sweep in contact with the feature; -1: none, or unknown
    contact_known : whether it is known
    """

    scene: Scene
    criteria: ConvergenceCriteria
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
    reason: tuple[str, ...]
    truth: np.ndarray | None
    travel: np.ndarray
    seconds: np.ndarray
    refused: int
    contact: tuple[int, int] = NO_CONTACT
    contact_known: bool = False

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
    def reaches_contact(self) -> bool:
        """Whether the sweep begins without contact and then has it."""
        return self.contact[0] > 0

    @property
    def on_contact(self) -> np.ndarray:
        """Whether each estimate is between contact and the end of the feature, (n,) bool."""
        first, last = self.contact
        return (self.row >= first) & (self.row <= last) & (first >= 0)


def replay(
    localizer: Localizer, recording: Recording, progress: Progress | None = None
) -> list[ReplayedSweep]:
    """Localize each sweep of a recording from a uniform prior.

    Parameters
    ----------
    localizer : localizer, reset before each sweep
    recording : recording whose positions are the odometry, with the axes and phalanges of the localizer
    progress : called with a description of the work and the completed fraction
    """
    replayed = []
    done, total = 0, max(len(recording), 1)
    for sweep in recording.sweeps:
        localizer.reset()
        taken: list[tuple[int, Estimate, float]] = []
        for row, sample in enumerate(sweep.samples()):
            if progress is not None and row % _REPORT_EVERY == 0:
                progress("replaying", (done + row) / total)
            began = time.thread_time()
            with contextlib.suppress(MeasurementError):  # counted as refused
                estimate = localizer.update(*sample)
                taken.append((row, estimate, time.thread_time() - began))
        done += len(sweep)
        replayed.append(_replayed_sweep(localizer, sweep, taken))
    if progress is not None:
        progress("replaying", 1.0)
    return replayed


def _replayed_sweep(
    localizer: Localizer, sweep: RecordedSweep, taken: Sequence[tuple[int, Estimate, float]]
) -> ReplayedSweep:
    """The replayed sweep with the estimates at some of its rows, and their computing times."""
    scene, row = localizer.scene, np.array([row for row, _, _ in taken], dtype=np.intp)
    d, reference = scene.dimension, sweep.position
    if sweep.truth is not None and np.isfinite(sweep.truth).all():
        reference = sweep.truth

    def values(name: str) -> np.ndarray:
        return np.array([getattr(estimate, name) for _, estimate, _ in taken])

    return ReplayedSweep(
        scene=scene,
        criteria=localizer.criteria,
        number=sweep.number,
        row=row,
        stamp_ns=sweep.stamp_ns[row],
        mean=values("mean").reshape(-1, d),
        covariance=values("covariance").reshape(-1, d, d),
        state=tuple(estimate.state for _, estimate, _ in taken),
        reason=tuple(estimate.reason for _, estimate, _ in taken),
        probability=values("probability"),
        on_map=values("on_map"),
        log_marginal=values("log_marginal"),
        updated=values("updated").astype(bool),
        truth=None if sweep.truth is None else sweep.truth[row],
        travel=travelled(scene, reference)[row],
        seconds=np.array([seconds for _, _, seconds in taken]),
        refused=len(sweep) - len(row),
        contact=sweep.contact,
        contact_known=sweep.felt is not None,
    )
