"""Counters that count samples, messages, all frames, samples inside the sensor, microseconds, or nothing."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import can
import numpy as np
import pytest
from support.load_cells import write_cells

from tactile_localizer.io.can.assembler import Cycle, CycleAssembler, PhalanxCounts
from tactile_localizer.io.can.counter import RollingCounter
from tactile_localizer.io.can.protocol import FrameKind, LoadCellProtocol

T0_S = 1.7e9
PERIOD_S = 0.02


def hand(folder: Path, bits: int = 16, limits: str = "[0|0]", parts: str = "ab") -> LoadCellProtocol:
    """A load cell of one gauge and one counter per message; the strain is the number of the sample, V."""
    cells = {f"index_{part}": [f"gauge_{k + 1}"] for k, part in enumerate(parts)}
    return LoadCellProtocol(write_cells(folder / "hand.dbc", cells, f"{bits} {limits}"), ["index"])


@dataclass
class Sender:
    """Frames of a load cell: ``value(n, k)`` is the counter of sample ``n`` in message ``k``."""

    hand: LoadCellProtocol
    value: Callable[[int, int], int]
    bits: int = 16
    period_s: float = PERIOD_S

    def frames(self, numbers: range, lost: set[tuple[int, int]] | None = None) -> list[can.Message]:
        data = (
            (n, k, n.to_bytes(2, "little") + (self.value(n, k) % (1 << self.bits)).to_bytes(4, "little"))
            for n in numbers
            for k in range(len(self.hand.messages))
            if (n, k) not in (lost or ())
        )
        return [
            can.Message(
                timestamp=T0_S + n * self.period_s + 3e-4 * k,
                arbitration_id=256 + k,
                is_extended_id=False,
                data=content,
            )
            for n, k, content in data
        ]


@dataclass
class Received:
    cycles: list[Cycle]
    counts: PhalanxCounts
    frames: list[int]

    @property
    def complete(self) -> int:
        return sum(not one.status.any() for one in self.cycles)


def received(sender: Sender, count: int = 300, lost: set[tuple[int, int]] | None = None) -> Received:
    assembler = CycleAssembler(sender.hand)
    cycles = assembler.feed(sender.frames(range(count), lost))
    return Received(cycles, assembler.counts.phalanges[0], assembler.counts.frames)


rng = np.random.default_rng(0)
TIMES_US = 20_000 * np.arange(400)[:, None] + [0, 300] + rng.integers(-40, 40, (400, 2))
KINDS: dict[str, Callable[[int, int], int]] = {
    "samples": lambda n, k: n,
    "the samples of each message": lambda n, k: n + 77 * k,
    "all frames": lambda n, k: 2 * n + k,
    "samples inside the sensor": lambda n, k: 20 * n,
    "a time in us": lambda n, k: int(TIMES_US[n, k]),
    "samples up to 99": lambda n, k: n % 100,
    "samples from 1 to 100": lambda n, k: n % 100 + 1,
}


@pytest.mark.parametrize("kind", KINDS)
def test_a_counter_of_any_kind_is_used(tmp_path: Path, kind: str) -> None:
    bits = 32 if kind == "a time in us" else 16
    one = received(Sender(hand(tmp_path, bits), KINDS[kind], bits))
    assert one.complete >= 299
    assert (one.counts.drops, one.counts.jumps, one.counts.counter) == (0, 0, "")
    assert np.ptp([cycle.sequence[0] - n for n, cycle in enumerate(one.cycles[20:])]) == 0, "one per sample"

    lost = {(n, 1) for n in (150, 205, 206, 250)}
    one = received(Sender(hand(tmp_path, bits), KINDS[kind], bits), lost=lost)
    assert one.complete >= 299 - 4
    assert (one.counts.drops, one.counts.jumps, one.counts.counter) == (4, 0, "")


@pytest.mark.parametrize("held", [2, 4])
@pytest.mark.parametrize("parts", ["a", "ab"])
def test_a_counter_that_advances_once_in_several_samples_costs_none(
    tmp_path: Path, held: int, parts: str
) -> None:
    one = received(Sender(hand(tmp_path, parts=parts), lambda n, k: n // held))
    assert one.complete >= 299
    assert (one.counts.drops, one.counts.jumps, one.frames[FrameKind.DUPLICATE]) == (0, 0, 0)


@pytest.mark.parametrize("first", range(3))
def test_a_counter_of_all_frames_wraps_with_its_bits(tmp_path: Path, first: int) -> None:
    one = received(Sender(hand(tmp_path, 4, parts="a"), lambda n, k: 3 * n + first, 4))
    assert one.complete >= 299
    assert (one.counts.drops, one.counts.jumps, one.counts.counter) == (0, 0, "")


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_is_lost_while_the_usual_advance_is_learned(tmp_path: Path, kind: str) -> None:
    """Although the first frames come in lumps, of which the time tells nothing."""
    bits = 32 if kind == "a time in us" else 16
    sender = Sender(hand(tmp_path, bits, parts="a"), KINDS[kind], bits)
    frames = sender.frames(range(100))
    for n, frame in enumerate(frames[:40]):
        frame.timestamp = T0_S + PERIOD_S * 5 * (n // 5 + 1) - 1e-4 * (4 - n % 5)
    assembler = CycleAssembler(sender.hand)
    assembler.feed(frames)
    assert assembler.counts.phalanges[0].drops == 0


@pytest.mark.parametrize(
    ("value", "problem"),
    [
        (lambda n, k: 0, "is always 0"),
        (lambda n, k: n * n * 7919 % 65_536, "advances by "),
        (lambda n, k: 1000 - n, "advances by -1 to -1"),
    ],
    ids=["constant", "random", "down"],
)
def test_strain_is_published_whatever_the_counter_does(
    tmp_path: Path, value: Callable[[int, int], int], problem: str
) -> None:
    one = received(Sender(hand(tmp_path), value))
    assert one.complete >= 285
    assert one.counts.drops == 0
    assert one.counts.counter.startswith(problem)


@pytest.mark.parametrize(
    ("bits", "limits", "span"), [(4, "[0|14]", 15), (8, "[1|100]", 100), (4, "[0|15]", 16)]
)
def test_the_counter_wraps_after_the_range_of_the_dbc(
    tmp_path: Path, bits: int, limits: str, span: int
) -> None:
    first = int(limits[1])
    sender = Sender(hand(tmp_path, bits, limits), lambda n, k: n % span + first, bits)
    at_wraps = {(n, 0) for n in range(span - 1, 290, span)}
    one = received(sender, lost=at_wraps)
    assert (one.counts.drops, one.counts.jumps) == (len(at_wraps), 0)


def test_a_frame_that_is_not_sent_and_not_counted_costs_one_cycle(tmp_path: Path) -> None:
    sender = Sender(hand(tmp_path), lambda n, k: n - (k == 1 and n > 50))
    one = received(sender, lost={(50, 1)})
    assert one.complete == len(one.cycles) - 1 == 298
    assert (one.counts.drops, one.counts.jumps, one.frames[FrameKind.OUT_OF_ORDER]) == (1, 0, 0)


def test_only_some_messages_can_have_a_counter(tmp_path: Path) -> None:
    hand(tmp_path)
    text = (tmp_path / "hand.dbc").read_text()
    head, second = text.split("BO_ 257")
    (tmp_path / "hand.dbc").write_text(f"{head}BO_ 257{second.replace('counter', 'other')}")
    one = received(Sender(LoadCellProtocol(tmp_path / "hand.dbc", ["index"]), lambda n, k: n), lost={(50, 0)})
    assert one.complete == 298
    assert one.counts.drops == 1


def test_a_silence_of_the_whole_bus_is_not_a_restart(tmp_path: Path) -> None:
    sender = Sender(hand(tmp_path), lambda n, k: n + 3000)
    for pause, drops in ((90, 2 * 90), (50 * 60, 0)):  # of 1.8 s, and of a minute, as a hand that is off
        assembler = CycleAssembler(sender.hand)
        assembler.feed(sender.frames(range(100)))
        assembler.feed(sender.frames(range(100 + pause, 200 + pause)))
        (counts,) = assembler.counts.phalanges
        assert (counts.drops, counts.jumps) == (drops, 0)


def test_each_load_cell_counts_by_its_own_rate(tmp_path: Path) -> None:
    cells = dict.fromkeys(("index", "thumb"), ("gauge_1",))
    both = LoadCellProtocol(write_cells(tmp_path / "hand.dbc", cells, "4 [0|0]"), [*cells])
    frames = []
    for k, period_s in enumerate((0.01, 0.05)):
        for n in range(int(6 / period_s)):
            if n % 40 != 39:
                data = n.to_bytes(2, "little") + (n % 16).to_bytes(4, "little")
                stamp_s = T0_S + n * period_s + 0.002 * k
                frames.append(
                    can.Message(timestamp=stamp_s, arbitration_id=256 + k, is_extended_id=False, data=data)
                )
    assembler = CycleAssembler(both)
    cycles = assembler.feed(sorted(frames, key=lambda frame: frame.timestamp))
    index, thumb = assembler.counts.phalanges
    assert (index.drops, thumb.drops) == (14, 2)
    assert (index.jumps, thumb.jumps) == (0, 0)
    assert thumb.cycles_per_sample == pytest.approx(5, rel=0.05)
    assert index.cycles_per_sample == 1
    assert np.ptp([int(cycle.sequence[1]) - n // 5 for n, cycle in enumerate(cycles)]) <= 4


def test_a_counter_that_exceeds_the_time_has_jumped():
    counter = RollingCounter(256)
    for value in range(10):
        counter.advance(value, 1.0, 1.0)
    assert counter.advance(19, 10.0, 10.0) == 10, "as many as time allows are lost"
    assert counter.advance(39, 10.0, 10.0) == 1
    assert counter.jumps == 1


def test_a_load_cell_that_restarts_after_few_frames_does_not_give_the_range():
    counter = RollingCounter(256)
    for value in [*range(4), *range(10)]:
        assert counter.follows(value) or counter.advance(value, 1.0, 1.0) == 1
    assert (counter.span, counter.jumps) == (256, 1)


def test_the_range_of_a_counter_is_that_of_its_bits_without_offset_and_scale(tmp_path):
    path = write_cells(tmp_path / "hand.dbc", {"index_a": ["gauge_1"]}, "4 [10|38]")
    path.write_text(path.read_text().replace("(1,0) [10|38]", "(2,10) [10|38]"))
    (message,) = LoadCellProtocol(path, ["index"]).messages
    assert message.counter_values == range(15)
