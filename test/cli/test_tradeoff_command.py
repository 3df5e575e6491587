"""The command ``tradeoff``."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.cluster import cluster_of
from support.sweeps import CALIBRATION

from tactile_localizer.cli import main
from tactile_localizer.io.scans import learned
from tactile_localizer.io.scene_file import load_scene, save_scene
from tactile_localizer.resources import resource_path

COMMAND = (
    "tradeoff strain_0.csv strain_1.csv --poses poses_0.csv --poses poses_1.csv --scan bump_scan"
    " --configurations fast"
)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with ``test.csv`` of three sweeps, and ``bump_scan``, learned, of a scene without a region."""
    folder = tmp_path_factory.mktemp("tradeoff")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr(learned, "learn_model", lambda *_: (CALIBRATION, None))
        assert main(["simulate", "bump", "--test", "3", "-o", "."]) == 0
        scene = replace(load_scene(resource_path("config/scenes/bump.yaml")), feature=None)
        save_scene(scene, "scene.yaml")
        assert main(["import", "csv", "train.csv", "--scene", "scene.yaml", "-o", "bump_scan"]) == 0
    return folder


@pytest.fixture
def folder(files: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder :func:`files` as working directory; its calibration is stored."""
    monkeypatch.chdir(files)
    monkeypatch.setattr(learned, "learn_model", None)
    return files


@pytest.mark.slow
def test_configurations_are_compared_on_an_own_scan_without_a_region(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = Path("test.csv").read_text().partition("\n")[0].split(",")
    rows = np.loadtxt("test.csv", delimiter=",", skiprows=1)
    poses = [names.index(name) for name in ("stamp_s", "x", "y")]
    strain = [index for index, name in enumerate(names) if name not in ("sweep", "x", "y", "felt")]
    for sweep in (0, 1):
        for kind, columns in (("poses", poses), ("strain", strain)):
            header = ",".join(names[index] for index in columns)
            own = rows[rows[:, 1] == sweep][:, columns]
            np.savetxt(f"{kind}_{sweep}.csv", own, "%.9f", delimiter=",", header=header, comments="")
    Path("own.yaml").write_text("cell: 1.0\nupdate_distance: 0.001\n")
    Path("region.yaml").write_text("model: tactile_localizer.paper:Featureless\nfilter: particle\n")
    assert main(f"{COMMAND} own.yaml region.yaml --target-mm 100".split()) == 0
    printed = capsys.readouterr().out
    assert max(map(len, printed.partition("region:")[0].splitlines())) <= 80
    assert "region: not measured, scene bump: expected a feature region" in printed
    document = json.loads(Path("tradeoff/tradeoff.json").read_text())
    assert [one["candidate"] for one in document["candidates"]] == ["fast", "own"]
    assert [one["verdict"]["right"] for one in document["candidates"]] == [2, 2]
    assert Path("tradeoff/tradeoff.png").stat().st_size > 10_000
    assert main(["replay", "test.csv", "--scan", "bump_scan", "--config", "tradeoff/configuration.yaml"]) == 0
    assert main(f"{COMMAND} --target-mm 1e-9".split()) == 1
    assert "none; nearest is" in capsys.readouterr().out


@pytest.mark.slow
def test_two_workers_of_which_one_is_killed_find_what_one_process_finds(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    header, *rows = Path("test.csv").read_text().splitlines(keepends=True)
    for sweep in range(3):
        own = [row for row in rows if row.split(",")[1] == str(sweep)]
        Path(f"test_{sweep}.csv").write_text(header + "".join(own))
    Path("own.yaml").write_text("cell: 1.0\nupdate_distance: 0.003\n")
    Path("particles.yaml").write_text("filter: particle\nparticles: 75\nupdate_distance: 0.003\n")
    command = (
        "tradeoff test_0.csv test_1.csv test_2.csv --scan bump_scan --configurations own.yaml particles.yaml"
    )
    assert main([*command.split(), "-o", "here"]) == 0
    steps: list[float] = []
    with cluster_of(2, folder) as cluster:

        @contextmanager
        def progress() -> Iterator[Callable[[str, float], None]]:
            def show(what: str, done: float) -> None:
                if what == "replaying":
                    steps.append(done)
                    cluster.kill_a_worker()

            yield show

        monkeypatch.setattr("tactile_localizer.cli.tradeoff.progress_line", progress)
        assert main([*command.split(), "-o", "there", "--cluster", cluster.address]) == 0
    assert steps == [number / 6 for number in range(1, 7)]
    here, there = (json.loads(Path(name, "tradeoff.json").read_text()) for name in ("here", "there"))
    assert not there["not_measured"]
    assert len(here["candidates"]) == 2
    for one, other in zip(here["candidates"], there["candidates"], strict=True):
        assert one["candidate"] == other["candidate"]
        assert len(one["errors"]) == 3
        for name in ("errors", "coverage", "verdict", "difference"):
            assert one[name] == other[name]
