"""The command `replay`."""

import json
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.bags import pose, strain, write_bag
from support.cluster import cluster_of
from support.learned import unexamined

from tactile_localizer.cli import main
from tactile_localizer.io.configuration_file import load_configuration
from tactile_localizer.io.scans.folder import ScanFolder
from tactile_localizer.io.scene_file import load_scene, save_scene
from tactile_localizer.offline import parallel
from tactile_localizer.sim import shipped_scene

COMMAND = "replay test.csv --scan bump_scan --scene scene.yaml --filter grid --seed 1"


@pytest.fixture(scope="module")
def bump_files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with ``scene.yaml``, ``train.csv``, ``test.csv`` (two sweeps) and ``bump_scan``.

    ``line_scan`` has a single sweep, so learning from it is quick.
    """
    folder = tmp_path_factory.mktemp("bump")
    save_scene(shipped_scene("bump"), folder / "scene.yaml")
    assert run(f"simulate bump -o {folder} --test 2") == 0
    assert run(f"import csv {folder}/train.csv --scene {folder}/scene.yaml -o {folder}/bump_scan") == 0
    assert run(f"simulate bump -o {folder}/line --train 1 --test 1") == 0
    assert run(f"import csv {folder}/line/train.csv --scene {folder}/scene.yaml -o {folder}/line_scan") == 0
    return folder


@pytest.fixture
def bump_folder(bump_files: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder :func:`bump_files` as working directory."""
    monkeypatch.chdir(bump_files)
    return bump_files


def run(arguments: str) -> int:
    return main(arguments.split())


def document(path: str = "out.json") -> dict:
    return json.loads(Path(path).read_text())


def rows_of_test() -> np.ndarray:
    """The rows of ``test.csv`` by the names of its columns."""
    return np.genfromtxt("test.csv", delimiter=",", names=True)


def write_short(lines: int) -> None:
    """Write the first lines of ``test.csv`` to ``short.csv``."""
    Path("short.csv").write_text("\n".join(Path("test.csv").read_text().splitlines()[:lines]))


def write_bag_of(path: Path, rows: np.ndarray, origin: float = 0.0) -> None:
    """Write a bag of strain, truth and poses, whose x begins at ``origin``, with a sample every 10 ms."""
    names = [f"{phalanx}_{gauge}" for phalanx in ("index", "middle") for gauge in range(1, 9)]
    happened = []
    for i, row in enumerate(rows):
        now = 10 * (i + 1)
        values = np.array([row[name] for name in names])
        happened.append(("strain", now, strain(now, ("index", "middle"), strain=values)))
        happened.append(("palm_pose", now, pose(now, x=row["x"] + origin)))
        happened.append(("tactile_simulator/ground_truth", now, pose(now, x=row["x"])))
    write_bag(path, happened)


def updates_text(path: str) -> str:
    return Path(path).read_text().partition('"updates"')[2]


def test_import_and_replay_localize_and_write_every_update(bump_folder: Path, capsys) -> None:
    assert main([*COMMAND.split(), "--json", "out.json", "--plot", "out/error.png"]) == 0
    assert Path("out/error.png").stat().st_size > 10_000
    printed = capsys.readouterr().out
    assert max(map(len, printed.splitlines())) <= 80
    assert "sweep_mixture, grid filter; odometry simulated" in printed
    learned = printed.partition("learned from bump_scan:\n")[2].splitlines()[:6]
    assert [line[:22].strip() for line in learned] == [
        "material",
        "information length",
        "explanation length",
        "memory of the level",
        "noise of a channel",
        "registration",
    ]
    assert "mm after contact (median)" in printed
    assert "at contact" in printed
    assert "10 mm after contact" in printed
    assert "note:" not in printed
    assert re.search(r"^localized: (\d+) of \1 sweeps? right, 0 ever", printed, re.MULTILINE)
    found = document()
    assert found["verdict"] == {
        "success": True,
        **dict.fromkeys(("sweeps", "expected", "right"), 2),
        **dict.fromkeys(("wrong", "early", "lost", "never"), 0),
        "has_truth": True,
        "notes": [],
    }
    rows = rows_of_test()
    assert len(found["updates"]) == len(rows)
    assert found["summary"]["error_after_travel_m"]["0.01"]["max"] < 0.006
    assert found["summary"]["error_contact_m"]["count"] > 100
    last = found["updates"][-1]
    assert last["truth"] == pytest.approx([rows["x"][-1], rows["y"][-1]])
    assert last["error_m"] == pytest.approx(np.linalg.norm(np.subtract(last["mean"], last["truth"])))
    assert last["trace"] == pytest.approx(np.trace(last["covariance"]))
    assert last["stamp_s"] == pytest.approx(rows["stamp_s"][-1])
    assert {"sweep", "converged", "reason", "state", "probability", "on_map", "stamp_ns"} <= set(last)


@pytest.mark.parametrize(
    ("columns", "note"),
    [
        ("--column=x=x*1000 --column=y=y*1000", "note: 100% of the positions"),
        (
            "--config fast --column=index=index_1..8*1000 --column=middle=middle_1..8*1000",
            "note: 100% of the strains are outside the range of the scan (unit",
        ),
        (
            "--config fast --column=index=index_1..8*0.001 --column=middle=middle_1..8*0.001",
            "note: strain of index and middle varies by only 0.0",
        ),
    ],
)
def test_other_units_are_noted_and_not_localized(bump_folder: Path, capsys, columns: str, note: str) -> None:
    write_short(400)
    assert run(f"replay short.csv --scan bump_scan {columns}") == 1
    printed = capsys.readouterr().out
    assert note in printed
    assert "sweep 0 did not converge: " in printed
    assert "NOT localized" in printed


@pytest.mark.parametrize("random", ["--filter particle --odometry exact", "--filter grid"])
def test_updates_are_reproducible_by_seed(bump_folder: Path, random: str) -> None:
    short = f"replay short.csv --scan bump_scan --config fast {random}".split()
    write_short(120)
    for name, seed in (("a", "7"), ("b", "7"), ("c", "8")):
        assert main([*short, "--seed", seed, "--json", f"{name}.json"]) < 2
    assert updates_text("a.json") == updates_text("b.json")
    assert updates_text("a.json") != updates_text("c.json")
    assert document("a.json")["summary"] == document("b.json")["summary"]


def test_standard_output_may_have_the_json_alone(bump_folder: Path, capsys) -> None:
    write_short(120)
    short = ["replay", "short.csv", "--scan", "bump_scan", "--config", "fast", "--json"]
    status = main([*short, "short.json"])
    report = capsys.readouterr().out.partition("\n")[2]
    assert main([*short, "-"]) == status
    printed = capsys.readouterr()
    assert json.loads(printed.out)["updates"] == document("short.json")["updates"]
    assert printed.err.splitlines()[-1] == report.splitlines()[-1]
    assert not Path("-").exists()


def test_a_replay_reads_the_columns_of_the_import(bump_folder: Path, tmp_path: Path) -> None:
    for name in ("train", "test"):
        text = (bump_folder / f"line/{name}.csv").read_text()
        text = text.replace("stamp_s", "time").replace("index_", "g")
        (tmp_path / f"{name}.csv").write_text(text)
    naming = "--column stamp_s=time --column index=g1..8"
    assert run(f"import csv {tmp_path}/train.csv {naming} --scene scene.yaml -o {tmp_path}/scan") == 0
    options = "--odometry exact --config fast --json exact.json"
    run(f"replay {tmp_path}/test.csv --scan {tmp_path}/scan {options}")
    assert document("exact.json")["summary"]["odometry"] == "exact"
    assert document("exact.json")["configuration"]["cell"] == load_configuration("fast").cell


def test_a_bag_has_odometry_and_perhaps_ground_truth(bump_folder: Path, capsys) -> None:
    rows = rows_of_test()[:600]
    write_bag_of(bump_folder / "bag", rows, origin=4.0)
    assert run("replay bag --scan bump_scan --config fast --json bag.json") < 2
    found = document("bag.json")
    assert found["summary"]["odometry"] == "recorded"
    assert len(found["updates"]) == 600
    assert found["updates"][-1]["truth"][0] == pytest.approx(rows["x"][-1])
    assert run("replay bag --scan bump_scan --config fast --truth-topic /none") < 2
    assert "errors are unknown" in capsys.readouterr().out


def test_a_csv_with_true_positions_beside_the_arms_has_odometry(bump_folder: Path, capsys) -> None:
    write_short(200)
    header, *rows = [line.split(",") for line in Path("short.csv").read_text().splitlines()]
    rows = [[*row, *row[2:4]] for row in rows]
    drifted = [[*row[:2], f"{4.0 + float(row[2]):.7f}", *row[3:]] for row in rows]
    lines = map(",".join, [[*header, "true_x", "true_y"], *drifted])
    Path("arm.csv").write_text("\n".join(lines) + "\n")
    assert run("replay arm.csv --scan bump_scan --config fast --json arm.json") < 2
    found = document("arm.json")
    assert found["summary"]["odometry"] == "recorded"
    assert found["updates"][-1]["truth"][0] == pytest.approx(float(rows[-1][2]))
    assert run("replay arm.csv test.csv --scan bump_scan --config fast") == 2
    assert "expected true positions beside the arm's in all or in none" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (f"{'x' * 300} --scan bump_scan", "expected a CSV file, File name too long"),
        ("test.csv --scan bump_scan --config none.yaml", "none.yaml: expected a configuration file"),
        ("scene.yaml --scan bump_scan", "scene.yaml: expected a folder, or a file of .asc, "),
        ("empty.mcap test.csv --scan bump_scan", "test.csv: expected only bags beside a bag"),
    ],
)
def test_unusable_input_is_refused_in_one_line(
    bump_folder: Path, capsys, arguments: str, message: str
) -> None:
    assert main(["replay", *arguments.split()]) == 2
    printed = capsys.readouterr()
    assert message in printed.err
    assert printed.err.count("\n") == 1


def test_a_scan_of_another_scene_is_noted(bump_folder: Path, capsys) -> None:
    save_scene(replace(load_scene("scene.yaml"), name="other"), "other.yaml")
    write_short(120)
    assert run("replay short.csv --scan line_scan --scene other.yaml --config fast") < 2
    assert "note: line_scan was scanned with scene bump" in capsys.readouterr().err


def test_fabric_is_localized_globally(
    data_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("tactile_localizer.io.scans.learned.learn_model", unexamined)
    files = [str(data_dir / "fabric_slide" / f"Linen_F250_V20mmps_{repeat}.csv") for repeat in range(3)]
    reading = ["--columns", "fabric_slide.yaml", "--column", "x=timestamp*2e-5", "--scene", "linen.yaml"]
    assert main(["import", "csv", *files[:2], *reading, "-o", "linen_scan"]) == 0
    # A quarter of the strains, which is quicker and not easier.
    Path("sparse.yaml").write_text("update_distance: 0.002\n")
    options = ["--config", "sparse.yaml", "--json", "out.json"]
    assert main(["replay", files[2], "--scan", "linen_scan", *reading, *options]) == 0
    assert document()["summary"]["final_error_m"]["median"] < 0.001


def test_a_scan_may_have_more_phalanges_than_the_scene(bump_folder: Path) -> None:
    scene = load_scene("scene.yaml")
    save_scene(replace(scene, phalanges=scene.phalanges[1:]), "middle.yaml")
    arguments = "replay line_scan --scan line_scan --scene middle.yaml --config fast"
    assert main(arguments.split()) < 2
    store = ScanFolder("line_scan")
    assert store.scene.phalanx_names == ("index", "middle")


@pytest.mark.slow
def test_a_cluster_gives_the_digits_of_one_process_and_names_what_it_loses(
    bump_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    header, *rows = Path("test.csv").read_text().splitlines(keepends=True)
    for name, sweep in (("first", "0"), ("second", "1")):
        own = [row for row in rows if row.split(",")[1] == sweep]
        Path(f"{name}.csv").write_text(header + "".join(own))
    command = "replay first.csv second.csv --scan bump_scan --seed 1"
    assert run(f"{command} --json here.json") == 0
    with cluster_of(1, tmp_path) as cluster:
        assert run(f"{command} --json there.json --cluster {cluster.address}") == 0
        here, there = document("here.json"), document("there.json")
        for name in ("updates", "verdict"):
            assert there[name] == here[name] != []

        @contextmanager
        def progress() -> Iterator[Callable[[str, float], None]]:
            yield lambda what, _done: cluster.kill_a_worker() if what == "replaying" else None

        monkeypatch.setattr("tactile_localizer.cli.replay.progress_line", progress)
        monkeypatch.setattr(parallel, "_WITHOUT_WORKERS_S", 1.0)
        capsys.readouterr()
        assert run(f"{command} --cluster {cluster.address}") == 1
    printed = capsys.readouterr().out.splitlines()
    assert printed[-1].startswith("lost: ")
    assert printed[-1].endswith("/second.csv: the cluster has had no worker for 1 s")
    assert printed[0].startswith("1 sweep, ")
