"""Evidence for the map where the material is felt everywhere."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from tactile_localizer.core.hypotheses.correlation import Correlation, Sums
from tactile_localizer.core.likelihood.drift import Drift, innovations
from tactile_localizer.core.likelihood.weights import probability

PITCH, MEMORY, NODES, CHANNELS, PLACES = 0.0005, 0.01, 1000, 8, 100
HERE, STEPS = 30, 150


def material(seed: int) -> np.ndarray:
    """Strains (NODES, CHANNELS), in noise widths, correlated over 2 mm, of a material that repeats itself."""
    white = np.random.default_rng(seed).standard_normal((NODES, CHANNELS))
    smooth = gaussian_filter1d(white, 4.0, axis=0, mode="wrap")
    return 5.0 * smooth / smooth.std()


MAP = material(0)


def slide(of: np.ndarray = MAP, seed: int = 1) -> np.ndarray:
    """Strains (STEPS, CHANNELS) of a sweep from place :data:`HERE` on."""
    start = HERE * NODES // PLACES
    noise = np.random.default_rng(seed).standard_normal((STEPS, CHANNELS))
    return of[(start + np.arange(STEPS)) % NODES] + noise


def log_odds(strains: np.ndarray) -> np.ndarray:
    """Log-odds (PLACES,) of the map to chance, by place at which the palm is known to have begun."""
    places = np.arange(PLACES) * NODES // PLACES
    trend_filter = Drift(MEMORY, 1.0, np.full(CHANNELS, np.inf))
    correlation = Correlation(innovations(MAP, MEMORY, PITCH), 1.0, PLACES)
    trend, sums = trend_filter.start(PLACES), Sums.start(PLACES)
    for n, strain in enumerate(strains):
        expected = MAP[(places + n) % NODES].astype(np.float32)
        innovation, trend = trend_filter.update(trend, strain, expected, PITCH, 1.0)
        along = np.concatenate([innovation.map[:1], innovation.map])
        sums = correlation.update(sums, innovation.strain, along, np.ones(1 + PLACES), np.ones(1), PITCH)
    away = (np.arange(PLACES) - np.arange(PLACES)[:, None]) % PLACES
    far = np.minimum(away, PLACES - away) > 2
    # A belief in one place has the sums of the anchor there.
    beliefs = [np.concatenate([[place], 1 + np.arange(PLACES)]) for place in 1 + np.arange(PLACES)]
    return np.array(
        [
            correlation.log_odds(
                sums._replace(strain=sums.strain[rows], map=sums.map[rows], product=sums.product[rows]),
                np.eye(PLACES)[place],
                far[place],
            )
            for place, rows in enumerate(beliefs)
        ]
    )


OWN = log_odds(slide())


def test_it_rises_on_the_own_map_and_only_where_the_hand_is() -> None:
    assert OWN.argmax() == HERE
    assert OWN[HERE] > 10.0
    assert np.delete(OWN, HERE).max() < 0.0


def test_other_material_is_seldom_taken_for_the_map_even_where_it_resembles_it_most() -> None:
    best = [log_odds(slide(material(seed), seed)).max() for seed in range(10, 30)]
    assert np.mean([probability(odds) > 0.9 for odds in best]) <= 0.05


RAMP = np.outer(5.0 * np.arange(STEPS) * PITCH / 0.1, np.tile([1.0, -1.0], CHANNELS // 2))


@pytest.mark.parametrize(
    ("change", "tolerance"),
    [
        (lambda strain: strain + 1e3 * np.arange(CHANNELS), 1e-3),
        (lambda strain: strain + RAMP, 0.1),
        (lambda strain: 1.3 * strain, 0.1),
        (lambda strain: 0.3 * strain, 0.4),
        (lambda strain: 3.0 * strain, 0.3),
    ],
    ids=["offset", "drift of 5 noise widths per 100 mm", "gain", "weaker", "stronger"],
)
def test_it_depends_on_no_offset_drift_or_scale(change, tolerance: float) -> None:
    changed = log_odds(change(slide()))
    assert changed.argmax() == HERE
    assert changed[HERE] == pytest.approx(OWN[HERE], rel=tolerance)


def test_a_relocated_hand_begins_anew() -> None:
    filled = Sums(9, *np.arange(1.0, 10.0).reshape(3, 3), -2.0)
    relocated = filled.relocated(1.5)
    np.testing.assert_array_equal([relocated.strain, relocated.map, relocated.product], np.zeros((3, 3)))
    assert relocated.prior == 1.5
    assert filled.relocated(50.0).prior == pytest.approx(np.log(100.0))
