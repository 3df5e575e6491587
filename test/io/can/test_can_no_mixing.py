"""No strain vector holds samples of different cycles, whatever happens to the bus and to the receive times.

``TACTILE_LOCALIZER_CASES=10000`` runs as many cases; the default is 200.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache

import can
import numpy as np
import pytest
from support.load_cells import PERIOD_NS, START_NS, cycle, number_of, protocol, sample, strain_of, warm_up

from tactile_localizer.io.can.assembler import CycleAssembler
from tactile_localizer.io.can.cycle import Cycle
from tactile_localizer.io.can.protocol import LoadCellProtocol
from tactile_localizer.io.status import MISSING, OK

pytestmark = pytest.mark.slow

CASES = int(os.environ.get("TACTILE_LOCALIZER_CASES", "200"))
BLOCK = 100
MS = 1_000_000
QUIET = 80
"""Cycles at the end of each case in which nothing goes wrong."""

CLASSIC, FD = "loadcells.dbc", "loadcells_fd.dbc"


@cache
def hand_of(dbc: str, phalanges: int) -> tuple[LoadCellProtocol, np.ndarray]:
    """A hand, and the data of its frames: (phalanx, number, frame, byte), with counters of 0."""
    hand = protocol(("index", "middle", "ring")[:phalanges], dbc)
    frames = [
        [[list(f.data) for f in hand.encode(p, strain_of(p, n), 0)] for n in range(500)]
        for p in range(phalanges)
    ]
    return hand, np.array(frames, dtype=np.uint8)


@dataclass
class Bus:
    """What happens to the frames of one case, drawn from ``rng``.

    Silences of the load cells follow each other, or, ``overlapping``, each load cell has its own.
    """

    rng: np.random.Generator
    overlapping: bool = False

    def __post_init__(self) -> None:
        rng = self.rng
        self.dbc = str(rng.choice([CLASSIC, CLASSIC, FD]))
        self.phalanges = int(rng.choice([2, 2, 2, 3]))
        self.hand, self.data = hand_of(self.dbc, self.phalanges)
        self.parts = self.data.shape[2]
        self.span = 16 if self.dbc == CLASSIC else 65536
        self.cycles = QUIET + int(rng.integers(100, 220))
        self.period_ns = int(rng.choice([1, 5, 10]) * MS)
        self.spacing_ns = min(0.13 * MS, self.period_ns / (2 * self.phalanges * self.parts))
        self.wait_s = float(rng.choice([0.004, 0.03, 0.2]))
        self.loss = float(rng.choice([0, 0, 0.02, 0.1, 0.3]))
        self.doubled = float(rng.choice([0, 0, 0.02]))
        self.jitter_ns = float(rng.choice([0, 0.2, 1.0]) * MS)
        self.any_order = bool(rng.random() < 0.35)
        # Frames that are held up delay all that follow, or arrive together with them when they are let go:
        # then no more of the time than half, or the frames would pile up for ever.
        self.delays_all = bool(rng.random() < 0.5)
        self.held_up = float(rng.choice([0, 0.003, 0.02, 0.1]))
        if not self.delays_all:
            self.held_up = min(self.held_up, self.period_ns / (300 * MS * self.phalanges * self.parts))
        self._counters_and_silences()

    def _counters_and_silences(self) -> None:
        rng = self.rng
        first = rng.integers(0, self.span, self.phalanges if rng.random() < 0.5 else 1)[:, None]
        self.counter = np.tile(np.arange(self.cycles), (self.phalanges, 1)) + first
        self.silent = np.zeros((self.phalanges, self.cycles), dtype=bool)
        if self.overlapping:
            for p in range(self.phalanges):
                self._silences(lambda p=p: p)
        else:
            self._silences(lambda: int(rng.integers(self.phalanges)))

    def _silences(self, phalanx: Callable[[], int]) -> None:
        """Silences one after the other, each of the load cell that ``phalanx`` returns, with restarts."""
        rng, begin = self.rng, 20
        while rng.random() < 0.7:
            begin += int(rng.integers(0, 40))
            p, end = phalanx(), begin + int(rng.choice([2, 3, 9, 15, 16, 17, 40, 60]))
            if end > self.cycles - QUIET:
                return
            self.silent[p, begin:end] = True
            if rng.random() < 0.6:  # it restarts, with a counter that nearly fits if it is one of 4 bits
                value = int(self.counter[p, end] + rng.integers(-2, 3)) if self.span == 16 else 0
                value = value if rng.random() < 0.6 else int(rng.integers(self.span))
                self.counter[p, end:] = value + np.arange(self.cycles - end)
            begin = end + 2

    def frames(self) -> list[can.Message]:
        """All frames, in the order of their arrival."""
        rng = self.rng
        keys = np.array([message.key for message in self.hand.messages]).reshape(-1, self.parts)
        order = rng.permutation(self.phalanges)
        key, stamps, data, counters = [], [], [], []
        self._now = self._delay = 0.0
        for n in range(self.cycles):
            quiet = n >= self.cycles - QUIET
            if n == self.cycles - QUIET:
                self._delay = max(self._delay, self._now - n * self.period_ns)
            phalanges = rng.permutation(self.phalanges) if self.any_order else order
            sent = [(p, part) for p in phalanges if not self.silent[p, n] for part in range(self.parts)]
            for place, (p, part) in enumerate(sent):
                for stamp in self._received(n * self.period_ns + place * self.spacing_ns, quiet):
                    key.append(keys[p, part])
                    stamps.append(START_NS + int(stamp))
                    data.append(self.data[p, n, part])
                    counters.append(self.counter[p, n] % self.span)
        bytes_, count = np.array(data), np.array(counters)
        if self.dbc == CLASSIC:
            bytes_[:, 7] |= count.astype(np.uint8)
        else:
            bytes_[:, 16], bytes_[:, 17] = count >> 8, count & 255
        return [
            can.Message(timestamp=stamp * 1e-9, arbitration_id=one, is_extended_id=False, data=row.tobytes())
            for one, stamp, row in zip(key, stamps, bytes_, strict=True)
        ]

    def _received(self, due: float, quiet: bool) -> list[float]:
        """Receive times, ns, of a frame that is due at ``due``; none where it is lost."""
        rng = self.rng
        due += self._delay
        copies = 1
        if not quiet:
            due += abs(rng.normal(0, self.jitter_ns))
            if rng.random() < self.held_up:
                held = rng.uniform(0, 300 * MS)
                if self.delays_all:
                    self._delay += held
                else:
                    self._now = max(self._now, due) + held
            if rng.random() < self.loss:
                return []
            copies += rng.random() < self.doubled
        self._now = max(self._now + 10_000, due)
        return [self._now] * copies

    def assemble(self) -> list[Cycle]:
        frames, assembler = self.frames(), CycleAssembler(self.hand, self.wait_s)
        size = int(self.rng.integers(1, 40))
        made: list[Cycle] = []
        for i in range(0, len(frames), size):
            made += assembler.feed(frames[i : i + size])
        return made


def numbers_in(cycle: Cycle) -> set[int]:
    """Samples that the phalanges that are not missing are of; fails where one is put together of two."""
    return {
        number_of(p, cycle.strain[8 * p : 8 * p + 8])
        for p, status in enumerate(cycle.status)
        if not status & MISSING
    }


@pytest.mark.parametrize("overlapping", [False, True])
@pytest.mark.parametrize("first", range(0, CASES, BLOCK))
def test_no_vector_mixes_cycles(first: int, overlapping: bool) -> None:
    not_back = 0
    for seed in range(first, min(first + BLOCK, CASES)):
        bus = Bus(np.random.default_rng(seed), overlapping)
        made = bus.assemble()
        assert all(len(numbers_in(cycle)) <= 1 for cycle in made), f"seed {seed}"
        not_back += set(made[-1].status) != {OK}
    assert not_back <= 0.03 * BLOCK  # most load cells are aligned again after the quiet end


def assembled(hand: LoadCellProtocol, numbers: Sequence[tuple[int, int, int]]) -> list[Cycle]:
    """Cycles from samples (phalanx, number, counter), each stamped when it is due, after a warm-up."""
    assembler = warm_up(CycleAssembler(hand, 0.2), hand)
    return [
        cycle
        for phalanx, number, counter in numbers
        for frame in hand.encode(
            phalanx,
            strain_of(phalanx, number),
            counter,
            stamp_s=1e-9 * (START_NS + number * PERIOD_NS + phalanx * MS // 4),
        )
        for cycle in assembler.feed([frame])
    ]


def both(numbers: Iterable[int]) -> list[tuple[int, int, int]]:
    return [(phalanx, number, number) for number in numbers for phalanx in (0, 1)]


def assert_not_mixed(made: Sequence[Cycle]) -> None:
    assert all(len(numbers_in(cycle)) <= 1 for cycle in made)


def test_load_cells_that_restart_a_cycle_apart_are_not_joined() -> None:
    hand, _ = hand_of(FD, 2)
    restarted = [(1, 151, 0)] + [(p, n, n - 152 + p) for n in range(152, 200) for p in (0, 1)]
    made = assembled(hand, both(range(100)) + restarted)
    assert_not_mixed(made)
    assert made[-1].status.tolist() == [OK, OK]


def test_a_silence_of_a_counters_span_joins_nothing() -> None:
    hand, _ = hand_of(CLASSIC, 2)
    made = assembled(hand, [*both(range(40)), (0, 40, 40), (1, 56, 56), *both(range(57, 80))])
    assert_not_mixed(made)
    assert made[-1].status.tolist() == [OK, OK]


def test_samples_are_not_joined_across_a_counter_span() -> None:
    hand, _ = hand_of(CLASSIC, 2)
    assembler = warm_up(CycleAssembler(hand, 0.2), hand)
    frames = [frame for n in range(40) for frame in cycle(hand, n)]
    frames += sample(hand, 0, 40)[:1] + sample(hand, 0, 56)[1:]
    frames += [frame for n in range(57, 80) for frame in cycle(hand, n)]
    assert_not_mixed([made for frame in frames for made in assembler.feed([frame])])


def test_a_restarted_counter_off_by_one_is_not_joined() -> None:
    hand, _ = hand_of(CLASSIC, 3)
    usual = [(p, n, n) for n in range(40) for p in (0, 1, 2)]
    without_first = [(2, n, n) for n in range(40, 57)]
    restarted = [one for n in range(57, 80) for one in ((1, n, n - 1), (2, n, n))]
    assert_not_mixed(assembled(hand, usual + without_first + restarted))


@pytest.mark.parametrize("dbc", [CLASSIC, FD])
def test_the_random_traffic_is_realistic(dbc: str) -> None:
    hand, data = hand_of(dbc, 2)
    count = 9 if dbc == CLASSIC else 0x1234
    sent = [list(frame.data) for frame in hand.encode(1, strain_of(1, 7), count)]
    for frame in data[1, 7]:
        if dbc == CLASSIC:
            frame[7] |= count
        else:
            frame[16], frame[17] = count >> 8, count & 255
    assert data[1, 7].tolist() == sent
