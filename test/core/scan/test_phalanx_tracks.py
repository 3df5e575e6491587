"""Tracks that one phalanx takes from another."""

import numpy as np
import pytest

from tactile_localizer.core.scan.phalanx_tracks import PhalanxTracks, fit_transfers
from tactile_localizer.core.scan.tracks import PITCH, Track
from tactile_localizer.scene import Axis, Phalanx, Scene

SPACING, APART, SIDE = 0.0025, 0.02, 0.06
PLANE = Scene(
    "plane",
    (Axis("x", 0.0, SIDE), Axis("y", 0.0, SIDE)),
    (Phalanx("index", (0.0, 0.5 * APART), 4), Phalanx("middle", (0.0, -0.5 * APART), 4)),
)
HALF = np.array([0.0, 0.5 * APART])
SHIFT = np.array([0.0006, -0.0004])
MATRIX = np.array([[1.0, 0.2, 0, 0], [0, 0.8, 0, 0.1], [0.3, 0, 1.1, 0], [0, 0, -0.2, 0.9]])


def felt(places: np.ndarray) -> np.ndarray:
    """Strain (N, 4) of a feature of a few millimetres at ``places`` (N, 2)."""
    x, y = (places - 0.5 * SIDE).T * 1e3
    near = np.exp(-0.5 * (x**2 + y**2) / 3.0**2)
    return 40.0 * near[:, None] * np.stack([x, y, np.ones_like(x), np.cos(x)], axis=1)


def scan(seed: int = 0, noise: float = 0.3) -> list[Track]:
    """Sweeps along x of a hand whose middle finger is displaced and has another load cell."""
    rng, tracks = np.random.default_rng(seed), []
    for y in np.arange(0.5 * SPACING, SIDE, SPACING):
        x = np.arange(0.0, SIDE, PITCH)
        palm = np.stack([x, np.full_like(x, y)], axis=1)
        index = felt(palm + HALF)
        middle = felt(palm - HALF + SHIFT) @ MATRIX.T
        strain = np.concatenate([index, middle], axis=1)
        strain += noise * rng.standard_normal(strain.shape)
        strain[:, :4] *= (np.abs(index).max(axis=1) > 1.0)[:, None]
        strain[:, 4:] *= (np.abs(middle).max(axis=1) > 1.0)[:, None]
        tracks.append(Track(palm, strain))
    return tracks


def test_matrix_and_displacement_between_two_phalanges_are_found() -> None:
    to_index, to_middle = fit_transfers(scan(), PLANE, SPACING)
    assert (to_index.source, to_index.target, to_middle.source, to_middle.target) == (1, 0, 0, 1)
    np.testing.assert_allclose(to_middle.matrix, MATRIX, atol=0.1)
    np.testing.assert_allclose(to_middle.displacement, -SHIFT, atol=1e-4)
    np.testing.assert_allclose(to_index.displacement, SHIFT, atol=1e-4)


def test_a_phalanx_knows_places_that_only_another_felt() -> None:
    tracks = scan()
    transfers = fit_transfers(tracks, PLANE, SPACING)
    # Without the sweeps in which the index felt the feature, its strain is that of the middle finger.
    others = [track for track in tracks if not track.strain[:, :4].any()]
    palm = np.array([[0.029, 0.0205], [0.031, 0.0195]])
    known, unknown = (
        PhalanxTracks(others, PLANE, SPACING, own).expectation(PLANE, palm).mean[:, 0, :4]
        for own in (transfers, [])
    )
    np.testing.assert_allclose(known, felt(palm + HALF), atol=8.0)
    assert not unknown.any()


def test_a_sweep_is_held_out_of_what_other_phalanges_felt_along_it() -> None:
    tracks = scan()
    whole = PhalanxTracks(tracks, PLANE, SPACING, fit_transfers(tracks, PLANE, SPACING))
    along = tracks[7].positions[50:70]
    assert whole.expectation(PLANE, along).transferred.any()
    assert whole.without(7).expectation(PLANE, along).distance.min() > 0.5 * SPACING


@pytest.mark.parametrize("sweeps", [(7, 15), (6, 7, 15), (7, 15, 16)])
def test_a_scan_of_a_few_sweeps_gives_finite_transfers(sweeps: tuple[int, ...]) -> None:
    tracks = scan()
    for transfer in fit_transfers([tracks[index] for index in sweeps], PLANE, SPACING):
        assert np.isfinite(transfer.matrix).all()
        assert np.isfinite(transfer.displacement).all()


def test_a_phalanx_that_felt_nothing_transfers_nothing() -> None:
    tracks = scan()
    for track in tracks:
        track.strain[:, 4:] = 0.0
    assert fit_transfers(tracks, PLANE, SPACING) == []


def test_phalanges_whose_offsets_are_wrong_share_nothing() -> None:
    phalanges = tuple(Phalanx(name, (0.0, 0.0), 4) for name in ("index", "middle"))
    assert fit_transfers(scan(), Scene("plane", PLANE.axes, phalanges), SPACING) == []


@pytest.mark.parametrize("axes", [("x",), ("y", "yaw")])
def test_phalanges_that_felt_different_material_share_nothing(axes: tuple[str, ...]) -> None:
    names = {"x": Axis("x", 0.0, 0.04), "y": Axis("y", 0.0, 0.04), "yaw": Axis("yaw", -0.1, 0.1)}
    offset = (0.0,) * len(axes)
    scene = Scene("part", tuple(names[axis] for axis in axes), (Phalanx("a", offset), Phalanx("b", offset)))
    assert fit_transfers([Track(np.zeros((9, len(axes))), np.ones((9, 16)))] * 3, scene, 0.0) == []
