"""Parameters are chosen by what localises held-out sweeps."""

import numpy as np
import pytest

from tactile_localizer.core.parameters import ModelParameters
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.spacing import base_widths
from tactile_localizer.core.selection import (
    Trial,
    choose_parameters,
    held_out_segments,
    search,
)
from tactile_localizer.errors import ScanError
from tactile_localizer.scene import Axis, Phalanx, Scene

SCENE = Scene("line", (Axis("x", 0.0, 0.06, 0.002),), (Phalanx("index", (0.0,)),))


def lines(sweeps: int = 4, noise: float = 0.05, pairs: int = 240, seed: int = 0) -> Scan:
    """Sweeps along one axis over a smooth random pattern of 1 V, with the same noise in each."""
    rng = np.random.default_rng(seed)
    x = np.tile(np.linspace(0.0, 0.06, pairs), sweeps)
    phases, waves = rng.uniform(0, 6, 8), rng.uniform(200, 500, 8)
    strain = np.sin(x[:, None] * waves + phases) + noise * rng.standard_normal((len(x), 8))
    return Scan(x[:, None], strain, np.repeat(np.arange(sweeps), pairs), ("x",), ("index",))


def test_each_segment_is_localised_on_a_map_without_its_sweep() -> None:
    scan = lines()
    for segment in held_out_segments(scan, SCENE):
        held_out = set(map(tuple, segment.strain))
        assert not held_out & set(map(tuple, segment.training.strain))


def test_displacements_of_a_segment_lead_along_its_states() -> None:
    segment = held_out_segments(lines(), SCENE)[0]
    along = segment.states[0] + np.cumsum(segment.displacements, axis=0)
    np.testing.assert_allclose(along, segment.states, atol=1e-12)


@pytest.fixture(scope="module")
def searched() -> tuple[list[Trial], list[float]]:
    """All trials of one search, and the shares that its progress told."""
    shares: list[float] = []
    return search(lines(), SCENE, lambda _, share: shares.append(share)), shares


def test_the_chosen_candidate_is_the_one_of_most_merit(searched: tuple[list[Trial], list[float]]) -> None:
    best = max(searched[0], key=lambda trial: trial.merit)
    assert choose_parameters(lines(), SCENE) == ModelParameters(
        pytest.approx(best.parameters.position_std),
        pytest.approx(best.parameters.strain_std),
        best.parameters.correlation_length,
        best.parameters.correlation_change,
        interpolate=False,
        sweep_offset=False,
    )
    assert best.score > 1.0


def test_noisier_scans_get_wider_strain_kernels(searched: tuple[list[Trial], list[float]]) -> None:
    quiet = max(searched[0], key=lambda trial: trial.merit).parameters
    noisy = choose_parameters(lines(noise=0.3), SCENE)
    assert np.mean(noisy.strain_std) > 2.0 * np.mean(quiet.strain_std)


def test_a_candidate_that_covers_too_little_has_less_merit_than_its_score() -> None:
    honest, proud = (Trial(1.0, 1.0, ModelParameters(), 3.0, coverage) for coverage in (0.95, 0.90))
    assert honest.merit == honest.score
    assert proud.merit < proud.score - 1.0


def test_progress_ends_at_one(searched: tuple[list[Trial], list[float]]) -> None:
    shares = searched[1]
    assert shares[-1] == 1.0
    assert all(0.0 <= share <= 1.0 for share in shares)


def test_a_scene_may_name_fewer_phalanges_than_the_scan_has() -> None:
    scan = lines()
    both = Scan(
        scan.states, np.hstack([scan.strain, 5.0 + scan.strain]), scan.sweep, ("x",), ("other", "index")
    )
    position, strain = base_widths(both, SCENE)
    assert position.shape == (1,)
    np.testing.assert_allclose(strain, base_widths(scan, SCENE)[1])


def test_a_scan_too_short_to_hold_out_is_refused_with_the_way_out() -> None:
    scan = Scan(np.full((20, 1), 0.01), np.ones((20, 8)), np.zeros(20, dtype=int), ("x",), ("index",))
    with pytest.raises(ScanError, match="give position_std"):
        choose_parameters(scan, SCENE)
