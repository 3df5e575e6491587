"""Tare: the average of a hand at rest, stored in a file."""

from pathlib import Path

import numpy as np
import pytest

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.errors import MeasurementError, ParameterError
from tactile_localizer.io.can.assembler import Cycle
from tactile_localizer.io.can.tare import load_tare, store_tare, tare_offset
from tactile_localizer.io.status import FAULT, MISSING, OK, SATURATED

HAND = ("index", "middle")
LAYOUT = ChannelLayout((8, 8))


def average_of(vectors: np.ndarray, status: tuple[int, int] = (OK, OK)) -> np.ndarray:
    cycles = [Cycle(0, vector, np.array(status), np.zeros(2)) for vector in vectors]
    return tare_offset(cycles, HAND, LAYOUT, spread_limit=0.02)


def test_tare_averages_a_hand_at_rest() -> None:
    rng = np.random.default_rng(0)
    offset = rng.uniform(-1, 1, 16)
    vectors = offset + rng.normal(0, 0.001, (200, 16))
    vectors[::3, 8:] = np.nan  # a phalanx missing now and then
    vectors[3, 5] = np.inf
    np.testing.assert_allclose(average_of(vectors), offset, atol=0.0005)


def test_a_moving_hand_is_refused() -> None:
    vectors = np.zeros((200, 16))
    vectors[:, 10] = np.linspace(0, 0.2, 200)
    with pytest.raises(MeasurementError, match=r"at rest.*gauge 3 of middle"):
        average_of(vectors)


@pytest.mark.parametrize("received", [0, 9])
def test_too_few_samples_are_refused(received: int) -> None:
    vectors = np.zeros((200, 16))
    vectors[received:, 8:] = np.nan
    with pytest.raises(MeasurementError, match=f"samples of middle, got {received}"):
        average_of(vectors)
    with pytest.raises(MeasurementError, match="samples of index, got 0"):
        average_of(np.zeros((0, 16)))


@pytest.mark.parametrize("status", [MISSING, SATURATED, FAULT])
def test_phalanges_with_bad_status_are_refused(status: int) -> None:
    with pytest.raises(MeasurementError, match="samples of middle, got 0"):
        average_of(np.zeros((20, 16)), (OK, status))


def test_offsets_are_stored_by_phalanx(tmp_path: Path) -> None:
    path = tmp_path / "kept" / "tare.yaml"
    assert not load_tare(path, HAND, LAYOUT).any()
    both = np.arange(16) / 7
    store_tare(path, HAND, both, LAYOUT)
    np.testing.assert_array_equal(load_tare(path, ("middle", "thumb"), LAYOUT), [*both[8:], *np.zeros(8)])
    store_tare(path, ("index",), np.zeros(8), ChannelLayout((8,)))  # cleared
    np.testing.assert_array_equal(load_tare(path, HAND, LAYOUT), [*np.zeros(8), *both[8:]])
    assert [file.name for file in path.parent.iterdir()] == ["tare.yaml"]


@pytest.mark.parametrize("text", ["index: [1, 2]\n", "- 1\n", "index: [a, 0, 0, 0, 0, 0, 0, 0]\n", "{", "\0"])
def test_other_files_than_tare_files_are_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "tare.yaml"
    path.write_text(text)
    with pytest.raises(ParameterError, match=r"tare\.yaml: .*expected ") as refusal:
        load_tare(path, HAND, LAYOUT)
    assert "\n" not in str(refusal.value)


def test_an_unwritable_tare_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ParameterError, match=r"tare\.yaml: could not be written"):
        store_tare(tmp_path / "file" / "tare.yaml", HAND, np.ones(16), LAYOUT)
