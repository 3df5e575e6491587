"""Live recording of sweeps: assigns incoming pairs to sweeps by their stamps and stores them."""

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
from tactile_localizer.streams.sweep_detector import NO_SWEEP, SweepDetector

StrainSample = tuple[np.ndarray, np.ndarray]
"""Strain voltages (C,), V, and status bits (F,)."""

_BEFORE_ALL_NS = -1
"""A stamp earlier than that of any sample, ns."""


class SweepRecorder:
    """Records sweeps that are requested, or that are detected in the motion.

    A sweep is an interval of time: what is stamped within it belongs to it, whenever it arrives, also after
    the sweep has ended. Importing a bag of the same topics gives the same scan.

    Parameters
    ----------
    store : scan to record to
    detector : detects the sweeps; ``None``: :meth:`start` and :meth:`end` begin and end them
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
        detector: SweepDetector | None,
        coverage: Coverage,
        on_change: Callable[[int], None] = lambda stamp_ns: None,
    ) -> None:
        self.store = store
        self.number = store.last_number
        self.gaps = self.skipped = 0
        for sweep in self._count():
            coverage.add(sweep.position)
        self._detector = detector
        self._coverage = coverage
        self._on_change = on_change
        self._incomplete: deque[OpenSweep] = deque()  # of which the last may be active
        self._detected = NO_SWEEP
        self._newest_ns = _BEFORE_ALL_NS
        self._batch: list[Pair[StrainSample]] = []

    @property
    def is_active(self) -> bool:
        """Whether a sweep is open."""
        return bool(self._incomplete) and self._incomplete[-1].until_ns is None

    @property
    def began_ns(self) -> int | None:
        """Stamp before the first sample of the open sweep, ns; ``None`` if none is open."""
        return self._incomplete[-1].after_ns if self.is_active else None

    @property
    def incomplete(self) -> int | None:
        """Number of the oldest sweep that is not complete, because samples wait for poses or it is open."""
        return self._incomplete[0].number if self._incomplete else None

    def start(self, after_ns: int) -> int:
        """Open a sweep of the samples with stamps later than ``after_ns``; returns its number.

        Raises
        ------
        ScanError
            A sweep is open, or it cannot be written.
        """
        if self.is_active:
            raise ScanError(f"start sweep: expected no active sweep, found sweep {self.number}")
        self._incomplete.append(self.store.begin_sweep(after_ns))
        self.number = self._incomplete[-1].number
        self.sweeps += 1
        self._on_change(after_ns)
        return self.number

    def end(self, until_ns: int) -> OpenSweep:
        """End the open sweep with the sample at stamp ``until_ns``; :meth:`settle` completes it.

        Raises
        ------
        ScanError
            No sweep is open.
        """
        if not self.is_active:
            raise ScanError("end sweep: expected an active sweep, found none")
        self._incomplete[-1].until_ns = until_ns
        self._on_change(until_ns)
        return self._incomplete[-1]

    def is_complete(self, sweep: OpenSweep) -> bool:
        """Whether all samples of a sweep are written, or it was abandoned."""
        return sweep not in self._incomplete

    def take(self, pairs: Sequence[Pair[StrainSample]]) -> None:
        """Collect the pairs that belong to a sweep; :meth:`settle` writes them.

        Parameters
        ----------
        pairs : in the order of their stamps. A backward jump of the stamps ends the sweep and, without a
            detector, opens another

        Raises
        ------
        ScanError
            The scan cannot be written. The sweep is abandoned; pairs already written are kept.
        """
        with self._abandoning():
            for pair in pairs:
                self._place(pair)

    def settle(self, settled_ns: float) -> None:
        """Write the pairs, and complete each sweep that has ended and of which no sample can follow.

        Call this at least every 0.25 s.

        Parameters
        ----------
        settled_ns : stamp up to which all samples were given to :meth:`take`

        Raises
        ------
        ScanError
            The scan cannot be written, or the file of a sweep was removed or cut short; the sweeps are
            abandoned. Pairs already written are kept; those of a file that was removed are written to
            another one.
        """
        with self._abandoning():
            self._finish_until(settled_ns)
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
            self.end(self._newest_ns)
        self.settle(math.inf)

    def _count(self) -> Sequence[RecordedSweep]:
        """Count the sweeps and pairs in the scan, which are returned."""
        known = self.store.recording().sweeps
        self.sweeps, self.pairs = len(known), sum(map(len, known))
        return known

    def _place(self, pair: Pair[StrainSample]) -> None:
        if pair.stamp_ns < self._newest_ns:
            self._restart()
        self._newest_ns = pair.stamp_ns
        if self._detector is not None and pair.position is not None:
            detected = self._detector.update(pair.stamp_ns, pair.position, pair.run)
            self._follow(detected, pair.stamp_ns)
        self._finish_until(pair.stamp_ns - 1)
        if self._incomplete and pair.stamp_ns > self._incomplete[0].after_ns:
            if pair.position is None:
                self.gaps += 1
                self._incomplete[0].gaps += 1
            else:
                self._batch.append(pair)

    def _follow(self, detected: int, stamp_ns: int) -> None:
        """End and start sweeps as detected in the motion, from the sample at ``stamp_ns`` on."""
        if detected != self._detected:
            self._detected = detected
            if self.is_active:
                self.end(stamp_ns - 1)
            if detected != NO_SWEEP:
                self.start(stamp_ns - 1)

    def _restart(self) -> None:
        """Start another sweep after a backward jump of the stamps."""
        was_active = self.is_active
        self.close()
        if self._detector is not None:
            self._detected = NO_SWEEP
        elif was_active:
            self.start(_BEFORE_ALL_NS)

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

    def _finish_until(self, stamp_ns: float) -> None:
        """Complete the sweeps that ended at ``stamp_ns`` or earlier."""
        while self._incomplete and (until := self._incomplete[0].until_ns) is not None and until <= stamp_ns:
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
            self._incomplete, self._batch, self._detected = deque(), [], NO_SWEEP
            raise
