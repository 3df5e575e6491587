"""Live recording: stores the pairs of a session by sweep."""

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace

import numpy as np

from tactile_localizer.errors import ScanError
from tactile_localizer.io.recording import USABLE, RecordedSweep, screen
from tactile_localizer.io.scans.sweep_files import OpenSweep
from tactile_localizer.io.scans.writer import ScanWriter
from tactile_localizer.streams.coverage import Coverage
from tactile_localizer.streams.session import Pair
from tactile_localizer.streams.sweep_detector import NO_SWEEP

StrainSample = tuple[np.ndarray, np.ndarray]
"""Strain voltages (C,), V, and status bits (F,)."""

_END = math.inf, math.inf
"""Run and stamp after all samples."""


class SweepRecorder:
    """Records sweeps that are requested, or that are detected in the motion.

    The session says which sweep a pair is in. Importing a bag of the same topics gives the same scan.

    Parameters
    ----------
    store : scan to record to
    detects : whether the session detects the sweeps; if not, :meth:`start` and :meth:`end` begin and end them
    coverage : updated with the pairs of the scan, and with those that are recorded
    on_change : called with the stamp, ns, after which a sweep begins or ends

    Attributes
    ----------
    sweeps, pairs : numbers of sweeps and pairs in the scan
    number : number of the newest sweep, also when it has ended; 0 before the first
    gaps : samples in sweeps without a pose close enough in time
    skipped : samples in sweeps that were missing, saturated or out of bounds
    """

    def __init__(
        self,
        store: ScanWriter,
        detects: bool,
        coverage: Coverage,
        on_change: Callable[[int], None] = lambda stamp_ns: None,
    ) -> None:
        self.store = store
        self.number = store.last_number
        self.gaps = self.skipped = 0
        for sweep in self._count():
            coverage.add(sweep.position)
        self._detects = detects
        self._coverage = coverage
        self._on_change = on_change
        self._incomplete: deque[OpenSweep] = deque()  # of which the last may be active
        self._label: tuple[int, int] | None = None  # run and sweep of the newest pair
        self._newest = 0, -1
        self._batch: list[Pair[StrainSample]] = []

    @property
    def is_active(self) -> bool:
        """Whether a sweep is open."""
        return bool(self._incomplete) and self._incomplete[-1].until is None

    @property
    def began_ns(self) -> int | None:
        """Stamp before the first sample of the open sweep, ns; ``None`` if none is open."""
        return self._incomplete[-1].after_ns if self.is_active else None

    @property
    def incomplete(self) -> int | None:
        """Number of the oldest sweep that is not complete, because samples wait for poses or it is open."""
        return self._incomplete[0].number if self._incomplete else None

    def start(self, run: int, after_ns: int, label: tuple[int, int] | None = None) -> int:
        """Open a sweep of the samples after a stamp of a run of the session, ns; returns its number.

        The session is to label its pairs with the number, unless they have another ``label``.

        Raises
        ------
        ScanError
            A sweep is open, or it cannot be written.
        """
        if self.is_active:
            raise ScanError(f"start sweep: expected no active sweep, found sweep {self.number}")
        sweep = self.store.begin_sweep(after_ns)
        sweep.label = label or (run, sweep.number)
        self._incomplete.append(sweep)
        self.number = sweep.number
        self.sweeps += 1
        self._on_change(after_ns)
        return self.number

    def end(self, run: int, until_ns: int) -> OpenSweep:
        """End the open sweep with the sample at a stamp of a run, ns; :meth:`settle` completes it.

        Raises
        ------
        ScanError
            No sweep is open.
        """
        if not self.is_active:
            raise ScanError("end sweep: expected an active sweep, found none")
        self._incomplete[-1].until = run, until_ns
        self._on_change(until_ns)
        return self._incomplete[-1]

    def is_complete(self, sweep: OpenSweep) -> bool:
        """Whether all samples of a sweep are written, or it was abandoned."""
        return sweep not in self._incomplete

    def take(self, pairs: Sequence[Pair[StrainSample]]) -> None:
        """Collect the pairs that belong to a sweep; :meth:`settle` writes them.

        Parameters
        ----------
        pairs : in the order of the session. A backward jump of the stamps ends the sweep and, unless sweeps
            are detected, opens another

        Raises
        ------
        ScanError
            The scan cannot be written. The sweep is abandoned; pairs already written are kept.
        """
        with self._abandoning():
            for pair in pairs:
                self._place(pair)

    def settle(self, settled: tuple[float, float] = _END) -> None:
        """Write the pairs, and complete each sweep that has ended and of which no sample can follow.

        Call this at least every 0.25 s.

        Parameters
        ----------
        settled : run and stamp, ns, up to which all samples were given to :meth:`take`

        Raises
        ------
        ScanError
            The scan cannot be written, or the file of a sweep was removed or cut short; the sweeps are
            abandoned. Pairs already written are kept; those of a file that was removed are written to
            another one.
        """
        with self._abandoning():
            self._finish_until(settled)
            self._flush()
            self._require_in_place(self._incomplete)

    def close(self) -> None:
        """End every sweep, without waiting for further samples.

        Raises
        ------
        ScanError
            The scan cannot be written.
        """
        if self.is_active:
            self.end(*self._newest)
        self.settle()
        self._label = None

    def _count(self) -> Sequence[RecordedSweep]:
        """Count the sweeps and pairs in the scan, which are returned."""
        known = self.store.recording().sweeps
        self.sweeps, self.pairs = len(known), sum(map(len, known))
        return known

    def _place(self, pair: Pair[StrainSample]) -> None:
        label, before = (pair.run, pair.sweep), (pair.run, pair.stamp_ns - 1)
        if label != self._label:
            self._turn(label, *before)
        self._label, self._newest = label, (pair.run, pair.stamp_ns)
        self._finish_until(before)
        if self._incomplete and self._incomplete[0].label == label:
            if pair.position is None:
                self.gaps += 1
                self._incomplete[0].gaps += 1
            else:
                self._batch.append(pair)

    def _turn(self, label: tuple[int, int], run: int, before_ns: int) -> None:
        """End and start sweeps that nobody requests: detected ones, and those of a new run."""
        open_run, open_sweep = self._incomplete[-1].label if self.is_active else label
        if self._detects or (open_run < run and open_sweep == label[1]):
            if self.is_active:
                self.end(run, before_ns)
            if label[1] != NO_SWEEP:
                self.start(run, before_ns, label)

    def _flush(self) -> None:
        if not self._batch:
            return
        stamp_ns = np.array([pair.stamp_ns for pair in self._batch], dtype=np.int64)
        states = np.array([pair.position for pair in self._batch])
        strain, status = (np.array(each) for each in zip(*(p.measurement for p in self._batch), strict=True))
        self._batch = []
        sweep = self._incomplete[0]
        keep = screen(self.store.scene, states, strain, status) == USABLE
        pairs = int(np.count_nonzero(keep))
        self.skipped += len(keep) - pairs
        sweep.skipped += len(keep) - pairs
        if pairs:
            self._coverage.add(states[keep])
            sweep.append(stamp_ns[keep], states[keep], strain[keep])
            self.pairs += pairs

    def _finish_until(self, last: tuple[float, float]) -> None:
        """Complete the sweeps that ended at a run and stamp or earlier."""
        while self._incomplete and (until := self._incomplete[0].until) is not None and until <= last:
            self._flush()
            self._incomplete[0].end()
            self._require_in_place([self._incomplete[0]])
            self._incomplete.popleft()

    def _require_in_place(self, sweeps: Iterable[OpenSweep]) -> None:
        """Require that the files of sweeps are in the scan; otherwise write their pairs to other files."""
        sweeps, problems = [*sweeps], []
        lost = [sweep for sweep in sweeps if not sweep.is_in_place]
        if len(lost) < len(sweeps):
            self.store.restore_scene()
        for sweep in lost:
            problems.append(f"{sweep.path}: expected the sweep as recorded, it was removed or cut short")
            if sweep.pairs:
                try:
                    number = max(self.number, self.store.last_number) + 1
                    self.store.add(replace(sweep.recorded(), number=number))
                    problems.append(f"its {sweep.pairs} pairs are in sweep {number}")
                except ScanError as error:
                    problems.append(str(error))
        if lost:
            with suppress(ScanError):
                self._count()
                self.number = self.store.last_number
            raise ScanError("; ".join(problems))

    @contextmanager
    def _abandoning(self) -> Iterator[None]:
        """Context whose failure to write ends all sweeps."""
        try:
            yield
        except ScanError:
            self._incomplete, self._batch, self._label = deque(), [], None
            raise
