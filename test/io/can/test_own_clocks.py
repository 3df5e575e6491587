"""Load cells without a common clock: cycles are cut at the largest gap between their frames."""

from pathlib import Path

import can
import numpy as np
import pytest
from support.load_cells import write_cells

from tactile_localizer.io.can.assembler import Cycle, CycleAssembler
from tactile_localizer.io.can.protocol import LoadCellProtocol

T0_S = 1.7e9
RATE_HZ = 50


def hand(folder: Path, cells: int) -> LoadCellProtocol:
    """Load cells of one gauge each, without counters; the strain is the number of the sample, V."""
    names = [f"cell{k:02d}" for k in range(cells)]
    return LoadCellProtocol(write_cells(folder / "hand.dbc", dict.fromkeys(names, ("gauge_1",))), names)


def cycles_of(own: LoadCellProtocol, times_s: list[np.ndarray], lost: set[tuple[int, int]]) -> list[Cycle]:
    """Cycles of load cells that send their samples at these times, but for (cell, sample) in ``lost``."""
    sent = [(t, k, n) for k, own_s in enumerate(times_s) for n, t in enumerate(own_s) if (k, n) not in lost]
    frames = [
        can.Message(
            timestamp=T0_S + t, arbitration_id=256 + k, is_extended_id=False, data=n.to_bytes(2, "little")
        )
        for t, k, n in sorted(sent)
    ]
    return CycleAssembler(own).feed(frames)


def complete(cycles: list[Cycle]) -> list[Cycle]:
    return [one for one in cycles if not one.status.any()]


def clocks(
    cells: int, seed: int, duration_s: float, drift: float = 5e-5, jitter_s: float = 1e-4
) -> list[np.ndarray]:
    """Send times of load cells with arbitrary phases and clocks of their own, with jitter, s."""
    rng = np.random.default_rng(seed)
    number = np.arange(int(duration_s * RATE_HZ))
    return [
        (rng.uniform() + number * (1 + rng.uniform(-drift, drift))) / RATE_HZ
        + rng.normal(0, jitter_s, len(number))
        for _ in range(cells)
    ]


@pytest.mark.parametrize("cells", [1, 2, 3, 5, 8, 14])
@pytest.mark.parametrize("seed", range(3))
def test_cycles_are_complete_at_any_phases(tmp_path: Path, cells: int, seed: int) -> None:
    cycles = cycles_of(hand(tmp_path, cells), clocks(cells, seed, 6.0), set())
    assert len(complete(cycles)) >= 0.99 * 300
    assert len(complete(cycles)) >= 0.99 * len(cycles)
    assert all(np.ptp(one.strain) <= 2 for one in complete(cycles)), "of one period"


@pytest.mark.parametrize("cells", [5, 8, 14])
def test_jitter_that_exchanges_frames_tears_few_cycles(tmp_path: Path, cells: int) -> None:
    own, cycles = hand(tmp_path, cells), list[Cycle]()
    for seed in range(4):
        times_s = [np.sort(own_s) for own_s in clocks(cells, seed, 6.0, jitter_s=1e-3)]
        cycles += cycles_of(own, times_s, set())
    assert len(complete(cycles)) >= 0.97 * max(4 * 300, len(cycles))
    assert all(np.ptp(one.strain) <= 2 for one in complete(cycles))


@pytest.mark.parametrize("cells", [2, 5, 14])
def test_phases_that_drift_through_each_other_are_followed(tmp_path: Path, cells: int) -> None:
    cycles = cycles_of(hand(tmp_path, cells), clocks(cells, 7, 40.0, drift=1e-3), set())
    assert len(complete(cycles)) >= 0.99 * len(cycles) > 0.98 * 40 * RATE_HZ


@pytest.mark.parametrize("cells", [3, 14])
def test_delays_of_the_whole_bus_neither_tear_nor_mix_cycles(tmp_path: Path, cells: int) -> None:
    rng = np.random.default_rng(3)
    times_s = clocks(cells, 2, 10.0)
    for begin_s in np.arange(1.0, 10.0, 0.5):
        end_s = begin_s + rng.uniform(0.005, 0.05)
        times_s = [np.where((t > begin_s) & (t < end_s), end_s + 1e-3 * (t - begin_s), t) for t in times_s]
    cycles = cycles_of(hand(tmp_path, cells), times_s, set())
    assert len(complete(cycles)) >= 0.98 * len(cycles) > 0.97 * 500
    spread = [int(np.ptp(one.strain)) for one in complete(cycles)]
    assert len(set(spread)) == 1, "the same samples belong together before and after"


@pytest.mark.parametrize("cells", [3, 4, 8])
@pytest.mark.parametrize("seed", range(4))
def test_losses_from_bursts_neither_mix_samples_nor_split_cycles(
    tmp_path: Path, cells: int, seed: int
) -> None:
    number = np.arange(300)
    times_s = [number / RATE_HZ + 3e-4 * k for k in range(cells)]
    rng = np.random.default_rng(seed)
    lost = {(k, n) for k in range(cells) for n in range(20, 300) if rng.uniform() < 0.05}
    cycles = cycles_of(hand(tmp_path, cells), times_s, lost)
    found = [one.strain[np.isfinite(one.strain)] for one in cycles]
    assert [np.ptp(strain) for strain in found] == [0.0] * len(found)
    numbers = [int(strain[0]) for strain in found]
    assert numbers == list(range(numbers[-1] + 1))
    assert numbers[-1] >= 298
    assert [{*one.sequence.tolist()} for one in cycles] == [{n + 1} for n in numbers]
    assert [len(strain) for strain in found] == [
        cells - sum((k, n) in lost for k in range(cells)) for n in numbers
    ]


@pytest.mark.parametrize("seed", range(4))
def test_the_first_cycles_are_whole_although_their_frames_come_in_bursts(tmp_path: Path, seed: int) -> None:
    times_s = clocks(5, seed, 6.0)
    for begin_s, end_s in ((0.001, 0.03), (0.05, 0.09), (0.15, 0.18)):
        times_s = [np.where((t > begin_s) & (t < end_s), end_s + 1e-3 * (t - begin_s), t) for t in times_s]
    cycles = cycles_of(hand(tmp_path, 5), times_s, set())
    assert len(complete(cycles)) >= 0.985 * 300
    assert len(complete(cycles)) >= 0.985 * len(cycles)


@pytest.mark.parametrize("cells", [2, 3, 8])
def test_each_sample_is_in_one_cycle_at_most(tmp_path: Path, cells: int) -> None:
    """Although many are lost while the cut moves."""
    times_s = clocks(cells, 5, 30.0, drift=1e-3)
    rng = np.random.default_rng(6)
    lost = {(k, n) for k in range(cells) for n in range(30 * RATE_HZ) if rng.uniform() < 0.3}
    strain = np.array([one.strain for one in cycles_of(hand(tmp_path, cells), times_s, lost)])
    assert np.isfinite(strain).mean() > 0.5
    for own in strain.T:
        assert (np.diff(own[np.isfinite(own)]) > 0).all()
