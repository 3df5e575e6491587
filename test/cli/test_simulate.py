"""The command `simulate`."""

import numpy as np
import pytest

from tactile_localizer import cli
from tactile_localizer.io.csv.recording import read_csv
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.sim import shipped_scene, simulate_recording


@pytest.fixture
def scene():
    return shipped_scene("snap")


def test_recordings_read_back_as_what_was_simulated(tmp_path, scene, capsys):
    command = f"simulate snap -o {tmp_path} --seed 3 --train 2 --test 3"
    assert cli.main(command.split()) == 0
    assert "train.csv: 2 sweeps" in capsys.readouterr().out
    for kind, sweeps in (("train", 2), ("test", 3)):
        read = read_csv(tmp_path / f"{kind}.csv", scene)
        assert not read.notes
        for one, expected in zip(
            read.sweeps, simulate_recording("snap", 3, kind, sweeps=sweeps).sweeps, strict=True
        ):
            position = expected.position if kind == "train" else expected.truth
            np.testing.assert_allclose(one.position, position, atol=1e-7)
            np.testing.assert_allclose(one.strain, expected.strain, atol=1e-6)
            np.testing.assert_array_equal(one.stamp_ns, expected.stamp_ns)
            np.testing.assert_array_equal(one.felt, expected.felt)


def test_errors_are_one_line(tmp_path, capsys):
    assert cli.main(["simulate", "bump", "-o", str(tmp_path), "--test", "0"]) == 2
    assert "at least one sweep" in capsys.readouterr().err


def test_shipped_scenes_contain_every_sweep_and_contact():
    beyond = {"train": 0.0, "test": 1e-3}  # m, of a sweep's end
    for feature in ("bump", "snap", "grommet"):
        scene = shipped_scene(feature)
        for kind in ("train", "test"):
            for sweep in simulate_recording(feature, 1, kind).sweeps:
                palm = sweep.position if kind == "train" else sweep.truth
                assert np.all((palm >= scene.lower - beyond[kind]) & (palm <= scene.upper + beyond[kind]))
                if sweep.felt.any():
                    ends = sweep.truth[list(sweep.contact)]
                    felt = np.vstack([ends + phalanx.offset for phalanx in scene.phalanges])
                    assert np.all(np.any(scene.feature.contains(felt).reshape(-1, 2), axis=0))


def test_sensors_with_other_channel_counts_have_a_scene(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert (
        cli.main(["simulate", "bump", "-o", ".", "--channels", "19", "6", "--train", "1", "--test", "1"]) == 0
    )
    scene = load_scene("scene.yaml")
    assert scene.layout.counts == (19, 6)
    assert read_csv("train.csv", scene).sweeps[0].strain.shape[1] == 25
    assert cli.main(["simulate", "bump", "--channels", "0", "6"]) == 2
    assert "channels: expected 2 numbers of 1 to 4096, got [0, 6]" in capsys.readouterr().err
