"""A hand that is lifted and set down elsewhere, by a known displacement, has another level."""

import numpy as np
import pytest
from support.scans import bump_scan, bump_strain, scene

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.core.localizer import Localizer

SHEET, OFFSETS = scene(), 8.0
LINE = np.arange(0.01, 0.045, 0.0005)


@pytest.fixture(scope="module")
def localizer() -> Localizer:
    """On a sheet with a bump, whose sweeps have offsets of 8 V."""
    scan = bump_scan(SHEET, OFFSETS)
    return build_localizer(scan, SHEET, Configuration(), np.random.default_rng(0))


@pytest.mark.parametrize("seed", range(3))
def test_the_position_stays_known_where_a_lifted_hand_is_set_down(localizer: Localizer, seed: int) -> None:
    """Three passes of the bump, each with another offset."""
    rng, size = np.random.default_rng(seed), SHEET.layout.size
    localizer.reset()
    stamp, on_map, errors = 0, [], []
    for y in (0.024, 0.026, 0.025):
        places = np.stack([LINE, np.full_like(LINE, y)], axis=1)
        offset = OFFSETS * rng.standard_normal(size)
        felt = bump_strain(places, size) + offset + rng.standard_normal((len(LINE), size))
        for place, strain in zip(places, felt, strict=True):
            stamp += 10_000_000
            estimate = localizer.update(stamp, place + 0.3, strain)
            on_map.append(estimate.on_map)
            errors.append(np.linalg.norm(estimate.mean - place))
    assert min(on_map[len(LINE) :]) > 0.8
    assert max(errors[len(LINE) :]) < 0.002


def test_a_phalanx_that_is_not_present_has_no_level(localizer: Localizer) -> None:
    localizer.reset()
    strain = np.full(SHEET.layout.size, OFFSETS)
    present = np.array([True, False])
    for number, x in enumerate(LINE):
        localizer.update(10_000_000 * (1 + number), np.array([x, 0.04]), strain, present)
    known = np.asarray(localizer._sweep.trend.measurements)
    measured = SHEET.layout.expand(present)
    assert known[measured].min() > 1.0
    assert not known[~measured].any()
