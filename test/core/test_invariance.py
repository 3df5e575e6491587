"""What must not matter does not: the same sweep localized after a change of unit, order, frame or rate.

Each test states how far an estimate may move, and the probability of being right. The sheet has a ridge whose
strain changes along it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from support.scans import raster

from tactile_localizer.core.calibration.calibration import Calibration
from tactile_localizer.core.calibration.examination import Examination
from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Axis, Phalanx, Scene

FINGERS = (Phalanx("index", (0.0, 0.0), 3), Phalanx("thumb", (0.004, -0.002), 2))
SHEET = Scene("sheet", (Axis("x", 0.0, 0.04, 0.003), Axis("y", 0.0, 0.024, 0.003)), FINGERS)
CALIBRATION = Calibration(np.full(2, 4e-4), Material.SHEET, examination=Examination(0.0017, 0.0017))
PERIOD_NS = 20_000_000
FILTERS = pytest.mark.parametrize("kind", ["grid", "particle"])


def without_noise(states: np.ndarray) -> np.ndarray:
    """Strains (N, 5) at states (N, 2): a ridge of 10 V across x."""
    x, y = (states - [0.02, 0.012]).T
    return (10.0 * np.exp(-0.5 * (x / 0.003) ** 2))[:, None] * np.sin(
        150.0 * y[:, None] + np.linspace(0.0, 3.0, 5)
    )


def felt(states: np.ndarray, seed: int) -> np.ndarray:
    """The same with white noise of 1 V."""
    return without_noise(states) + np.random.default_rng(seed).standard_normal((len(states), 5))


class Run(NamedTuple):
    """A scan, a sweep of n strains, and estimates: means (n, 2) and probabilities (n,) of being right."""

    scan: Scan
    scene: Scene
    positions: np.ndarray
    strain: np.ndarray
    period_ns: int = PERIOD_NS
    seed: int = 0

    def estimates(self, kind: str = "grid") -> tuple[np.ndarray, np.ndarray]:
        rng, configuration = np.random.default_rng(self.seed), Configuration(filter=kind, cell=0.9)
        localizer = build_localizer(self.scan, self.scene, configuration, rng, calibration=CALIBRATION)
        found = [
            localizer.update((1 + n) * self.period_ns, position, strain)
            for n, (position, strain) in enumerate(zip(self.positions, self.strain, strict=True))
        ]
        return np.array([each.mean for each in found]), np.array([each.probability for each in found])


def first() -> Run:
    """A sweep over the ridge, a strain each half a millimetre, with the noise of odometry."""
    x = np.arange(0.002, 0.036, 0.0005)
    path = np.column_stack([x, np.full(len(x), 0.0105)])
    drift = 0.003 * np.sqrt(0.0005) * np.random.default_rng(2).standard_normal(path.shape)
    drift[::2] = 0.0  # every other step is an update distance exactly
    return Run(
        raster(SHEET, lambda states, _: felt(states, 0), 0.004),
        SHEET,
        path + drift.cumsum(axis=0),
        felt(path, 3),
    )


FIRST = first()


@pytest.fixture(scope="module")
def before() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    return {kind: FIRST.estimates(kind) for kind in ("grid", "particle")}


def compare(
    one: tuple[np.ndarray, np.ndarray],
    other: tuple[np.ndarray, np.ndarray],
    metres: float,
    probability: float,
) -> None:
    np.testing.assert_allclose(other[0], one[0], rtol=0.0, atol=metres)
    np.testing.assert_allclose(other[1], one[1], rtol=0.0, atol=probability)


def scaled(run: Run, factor: np.ndarray | float, offset: np.ndarray | float = 0.0) -> Run:
    scan = replace(run.scan, strain=run.scan.strain * factor + offset)
    return run._replace(scan=scan, strain=run.strain * factor + offset)


CHANGES: dict[str, Callable[[Run], Run]] = {
    "micro": lambda run: scaled(run, 1e-6),
    "kilo": lambda run: scaled(run, 1e3),
    "offsets": lambda run: scaled(run, 1.0, np.array([5.0, -300.0, 1e3, 0.3, -7.0])),
    "one channel": lambda run: scaled(run, np.array([1.0, 1.0, 50.0, 1.0, 1.0])),
    "slower": lambda run: run._replace(period_ns=3 * PERIOD_NS),
    "frame": lambda run: run._replace(positions=run.positions + np.array([10.0, -10.0])),
    "far frame": lambda run: run._replace(positions=run.positions + 1e4),
    "sweeps numbered anew": lambda run: run._replace(scan=replace(run.scan, sweep=7 * run.scan.sweep + 100)),
}


@FILTERS
@pytest.mark.parametrize("change", CHANGES)
def test_units_speed_and_frame_do_not_matter(
    before: dict[str, tuple[np.ndarray, np.ndarray]], kind: str, change: str
) -> None:
    compare(before[kind], CHANGES[change](FIRST).estimates(kind), 1e-6, 1e-4)


@FILTERS
@pytest.mark.parametrize("of_scan", [False, True], ids=["of the scene", "of the scan too"])
def test_the_order_of_the_phalanges_does_not_matter(
    before: dict[str, tuple[np.ndarray, np.ndarray]], kind: str, of_scan: bool
) -> None:
    order = [3, 4, 0, 1, 2]
    changed = FIRST._replace(scene=replace(SHEET, phalanges=FINGERS[::-1]), strain=FIRST.strain[:, order])
    if of_scan:
        strain, names = FIRST.scan.strain[:, order], FIRST.scan.phalanges[::-1]
        changed = changed._replace(
            scan=replace(FIRST.scan, strain=strain, phalanges=names, channels=FIRST.scan.channels[::-1])
        )
    compare(before[kind], changed.estimates(kind), 1e-6, 1e-4)


def test_the_order_of_the_channels_hardly_matters(before: dict[str, tuple[np.ndarray, np.ndarray]]) -> None:
    """The prior of a sweep's level is averaged along whitened directions, which follow the order."""
    order = [2, 0, 1, 4, 3]
    scan = replace(FIRST.scan, strain=FIRST.scan.strain[:, order])
    changed = FIRST._replace(scan=scan, strain=FIRST.strain[:, order])
    compare(before["grid"], changed.estimates(), 1e-4, 0.01)


def test_a_grid_has_no_seed(before: dict[str, tuple[np.ndarray, np.ndarray]]) -> None:
    compare(before["grid"], FIRST._replace(seed=5).estimates(), 0.0, 0.0)


def test_pairs_recorded_twice_hardly_matter(before: dict[str, tuple[np.ndarray, np.ndarray]]) -> None:
    """The white noise of the scan is that of their differences; on the ridge the mean is not sure."""
    twice = {name: getattr(FIRST.scan, name).repeat(2, axis=0) for name in ("states", "strain", "sweep")}
    compare(before["grid"], FIRST._replace(scan=replace(FIRST.scan, **twice)).estimates(), 1e-3, 0.05)


def ends_alike(one: tuple[np.ndarray, np.ndarray], other: tuple[np.ndarray, np.ndarray]) -> None:
    """The position at the end, behind the ridge, where it has converged."""
    np.testing.assert_allclose(other[0][-1], one[0][-1], rtol=0.0, atol=3e-4)
    assert other[1][-1] == pytest.approx(one[1][-1], abs=0.01)
    assert one[1][-1] > 0.97


def test_a_mirrored_sheet_gives_the_mirrored_position(
    before: dict[str, tuple[np.ndarray, np.ndarray]],
) -> None:
    sign, shift = np.array([-1.0, 1.0]), np.array([0.04, 0.0])
    fingers = tuple(replace(each, offset=(-each.offset[0], each.offset[1])) for each in FINGERS)
    scan = replace(FIRST.scan, states=shift + sign * FIRST.scan.states)
    scene = replace(SHEET, phalanges=fingers)
    means, probability = FIRST._replace(scan=scan, scene=scene, positions=sign * FIRST.positions).estimates()
    ends_alike(before["grid"], (shift + sign * means, probability))


def test_strains_that_come_twice_count_once(before: dict[str, tuple[np.ndarray, np.ndarray]]) -> None:
    twice = FIRST._replace(
        positions=FIRST.positions.repeat(2, axis=0),
        strain=FIRST.strain.repeat(2, axis=0),
        period_ns=PERIOD_NS // 2,
    )
    ends_alike(before["grid"], twice.estimates())
