"""A load cell that repeats itself to the last bit is stuck."""

import numpy as np

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.hypotheses.phalanx_consistency import PhalanxConsistency

BOTH = np.ones(2, dtype=bool)
STEP = 0.0005


def observed(frozen: tuple[int, ...], steps: int = 10, present: np.ndarray = BOTH) -> PhalanxConsistency:
    """After ``steps`` strains of which those of the ``frozen`` phalanges never change."""
    consistency, rng = PhalanxConsistency(ChannelLayout((3, 3))), np.random.default_rng(0)
    for _ in range(steps):
        strain = rng.standard_normal(6)
        for phalanx in frozen:
            strain[3 * phalanx : 3 * phalanx + 3] = 0.123
        consistency.observe(strain, present, STEP)
    return consistency


def test_phalanges_whose_strains_change_are_consistent() -> None:
    assert observed(()).consistent.all()


def test_a_phalanx_that_repeats_itself_over_two_millimetres_is_stuck() -> None:
    assert observed((1,), steps=4).consistent.all()
    assert observed((1,)).consistent.tolist() == [True, False]


def test_where_all_repeat_themselves_none_is_stuck() -> None:
    """A replay of the same strain, or a quantised one on featureless material."""
    assert observed((0, 1)).consistent.all()


def test_a_phalanx_that_changes_again_is_taken_back() -> None:
    consistency = observed((1,))
    consistency.observe(np.arange(6.0), BOTH, STEP)
    assert consistency.consistent.all()


def test_an_absent_phalanx_is_not_stuck() -> None:
    assert observed((1,), present=np.array([True, False])).consistent.all()


def test_at_rest_none_is_stuck() -> None:
    consistency = PhalanxConsistency(ChannelLayout((3, 3)))
    rng = np.random.default_rng(0)
    for _ in range(1000):
        consistency.observe(np.concatenate([rng.standard_normal(3), np.ones(3)]), BOTH, 0.0)
    assert consistency.consistent.all()


def test_a_reset_takes_every_phalanx_as_consistent() -> None:
    consistency = observed((0,))
    consistency.reset()
    assert consistency.consistent.all()
