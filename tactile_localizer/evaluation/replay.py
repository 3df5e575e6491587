"""A recording through the localizer that runs live, as fast as the machine goes.

The localizer is given stamps, positions and strains in their order, exactly as the filter node gives them; it
starts from nowhere at each new sweep.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from tactile_localizer.core.localizer import Estimate, Localizer
from tactile_localizer.errors import MeasurementError
from tactile_localizer.evaluation.odometry import travelled
from tactile_localizer.io.recording import RecordedSweep, Recording, usable
from tactile_localizer.scene import Scene

Progress = Callable[[str, float], None]

_REPORT_EVERY = 500


@dataclass(frozen=True)
class Track:
    """What was believed along one sweep, an entry for each of its n strains that could be used.

    Parameters
    ----------
    number : of the sweep
    row : (n,) int, which sample of the recorded sweep each entry belongs to
    stamp_ns : (n,) int64
    mean, covariance : (n, d) and (n, d, d), m (yaw: rad)
    converged, updated : (n,) bool; ``updated``: the strain was weighed, not only the belief moved along
    evidence, log_marginal : (n,) nats
    reason : n texts
    truth : (n, d) or ``None``
    travel : (n,) m from the sweep's start, along the truth where all of it is known
    seconds : (n,) s, that the localizer took
    refused : strains that the localizer refused
    """

    number: int
    row: np.ndarray
    stamp_ns: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray
    converged: np.ndarray
    updated: np.ndarray
    probability: np.ndarray
    log_marginal: np.ndarray
    reason: tuple[str, ...]
    truth: np.ndarray | None
    travel: np.ndarray
    seconds: np.ndarray
    refused: int

    def __len__(self) -> int:
        return len(self.stamp_ns)

    @property
    def trace(self) -> np.ndarray:
        """Sum of the variances, (n,)."""
        return np.trace(self.covariance, axis1=1, axis2=2)


def replay(
    localizer: Localizer,
    recording: Recording,
    progress: Progress | None = None,
    clock: Callable[[], float] = time.perf_counter,
) -> list[Track]:
    """Localise each sweep of a recording from nowhere.

    Parameters
    ----------
    localizer : its state of before is lost
    recording : of the localizer's scene; its positions are the odometry
    progress : told the share that is done
    clock : s, measures what the localizer takes
    """
    tracks = []
    done, total = 0, max(len(recording), 1)
    for sweep in recording.sweeps:
        localizer.reset()
        estimates, rows, seconds = [], [], []
        for row, estimate, elapsed in _localise(localizer, sweep, clock):
            if estimate is not None:
                estimates.append(estimate)
                rows.append(row)
                seconds.append(elapsed)
            if progress is not None and row % _REPORT_EVERY == 0:
                progress("replaying", (done + row) / total)
        done += len(sweep)
        tracks.append(_track(localizer.scene, sweep, estimates, rows, seconds))
    if progress is not None:
        progress("replaying", 1.0)
    return tracks


def _localise(
    localizer: Localizer, sweep: RecordedSweep, clock: Callable[[], float]
) -> Iterator[tuple[int, Estimate | None, float]]:
    """For each sample its row, the estimate (``None``: refused) and the seconds it took."""
    samples = zip(sweep.stamp_ns.tolist(), sweep.position, sweep.strain, usable(sweep.status), strict=True)
    for row, sample in enumerate(samples):
        began = clock()
        try:
            estimate = localizer.update(*sample)
        except MeasurementError:
            estimate = None
        yield row, estimate, clock() - began


def _track(
    scene: Scene, sweep: RecordedSweep, estimates: list[Estimate], rows: list[int], seconds: list[float]
) -> Track:
    n, d = len(estimates), scene.dimension
    row = np.array(rows, dtype=np.intp)
    reference = sweep.position
    if sweep.truth is not None and np.isfinite(sweep.truth).all():
        reference = sweep.truth
    return Track(
        number=sweep.number,
        row=row,
        stamp_ns=sweep.stamp_ns[row],
        mean=np.array([e.mean for e in estimates]).reshape(n, d),
        covariance=np.array([e.covariance for e in estimates]).reshape(n, d, d),
        converged=np.array([e.converged for e in estimates], dtype=bool),
        updated=np.array([e.updated for e in estimates], dtype=bool),
        probability=np.array([e.probability for e in estimates]),
        log_marginal=np.array([e.log_marginal for e in estimates]),
        reason=tuple(e.reason for e in estimates),
        truth=None if sweep.truth is None else sweep.truth[row],
        travel=travelled(scene, reference)[row],
        seconds=np.array(seconds),
        refused=len(sweep) - n,
    )
