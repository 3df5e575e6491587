"""The command `scan`."""

import json
import sqlite3
from contextlib import closing

import numpy as np
import pytest
from support.old_scans import make_old

from tactile_localizer.cli import main
from tactile_localizer.io.scans.store import ScanStore
from tactile_localizer.io.scene_file import load_scene, save_scene, scene_from_dict
from tactile_localizer.scene import Axis, Phalanx, Scene
from tactile_localizer.sim import simulate_scan

SCENE = Scene(
    "sheet",
    (Axis("x", 0.0, 0.05), Axis("y", 0.0, 0.01)),
    (Phalanx("index", (0.0, 0.01)), Phalanx("middle", (0.0, -0.01))),
)


def record(path, lines=(0.0, 0.0025, 0.005, 0.0075, 0.01), scene=SCENE, seed=0, unit="V"):
    rng = np.random.default_rng(seed)
    x = np.linspace(0, 0.05, 101)
    with ScanStore.create(path, scene, strain_unit=unit) as store:
        for number, y in enumerate(lines):
            store.begin_sweep()
            stamp_ns = 1_700_000_000_000_000_000 + number * 10**10 + np.arange(len(x)) * 50_000_001
            strain = rng.normal(size=(len(x), 8 * len(scene.phalanges)))
            store.append(stamp_ns, np.column_stack([x, np.full_like(x, y)])[:, : scene.dimension], strain)
            store.end_sweep(gaps=number)


@pytest.fixture
def scan(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    record(tmp_path / "scan.db")
    return tmp_path / "scan.db"


def test_info_prints_totals_history_and_findings(scan, capsys):
    main(["scan", "drop-sweep", "scan.db", "2"])
    capsys.readouterr()
    assert main(["scan", "info", "scan.db"]) == 0
    output = capsys.readouterr().out
    assert output.startswith("scan.db: 404 pairs in 4 sweeps (1 dropped)\n")
    for text in (
        "sheet: x 0.0 to 50.0 mm (0.00 to 1.97 inch), y 0.0 to 10.0 mm",
        "index, middle, strain in V",
        "2023-11-14 22:13:20 to 2023-11-14 22:14:05 UTC",
        "drop sweep: sweep 2",
        "uneven spacing",
    ):
        assert text in output


def test_repair_keeps_the_intact_part(scan, capsys):
    assert main(["scan", "repair", "scan.db"]) == 0
    assert "nothing to repair" in capsys.readouterr().out
    content = scan.read_bytes()
    with ScanStore.open("scan.db") as store:
        strain = store.recording().sweeps[2].strain.tobytes()
    place = content.index(strain[:64])
    scan.write_bytes(content[:place] + b"damaged!" + content[place + 8 :])
    assert main(["scan", "info", "scan.db"]) == 2
    assert "error: scan.db: sweep 3 damaged, 1 of 1 batches cannot be read" in capsys.readouterr().err
    assert main(["scan", "repair", "scan.db"]) == 0
    lines = capsys.readouterr().out.splitlines()
    for line, expected in zip(
        lines, ("sweep 3: lost 1 of 1", "404 pairs in 4 sweeps", "scan.db.damaged"), strict=True
    ):
        assert expected in line
    assert main(["scan", "info", "scan.db"]) == 0


def test_missing_checksums_are_reported(scan, capsys):
    make_old(scan)
    main(["scan", "info", "scan.db"])
    assert "checksums  none" in capsys.readouterr().out
    main(["scan", "drop-sweep", "scan.db", "1"])
    main(["scan", "info", "scan.db"])
    assert "checksums" not in capsys.readouterr().out


MARKUP = "[/bold] [red]:smile: $x_{"


def test_names_are_printed_literally(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    finger = "[/index] $\\frac"
    scene = Scene(MARKUP, SCENE.axes, (Phalanx(finger, (0.0, 0.01)),))
    record(tmp_path / "[red]:smile:.db", scene=scene, unit="$[/V]")
    for action in ("info", "list"):
        assert main(["scan", action, "[red]:smile:.db"]) == 0
    output = capsys.readouterr().out
    for text in (
        f"[red]:smile:.db: 505 pairs in 5 sweeps\n  scene      {MARKUP}: x",
        f"{finger}, strain in $[/V]",
    ):
        assert text in output
    assert main(["scan", "plot", "[red]:smile:.db", "-o", "out", "--dpi", "30"]) == 0
    assert (tmp_path / "out" / "map_[_index] $\\frac.png").exists()


def test_a_damaged_history_is_reported(scan, capsys):
    details = (
        "{",
        "[]",
        '{"notes": 7}',
        '{"notes": ["a\\nb", 1]}',
        '{"\\ud800": "\\u001b[31m"}',
        "[" * 100_000,
    )
    with closing(sqlite3.connect(scan)) as connection, connection:
        for detail in details:
            connection.execute(
                "INSERT INTO history (at, what, detail) VALUES ('now\n', 'merge', ?)", (detail,)
            )
    assert main(["scan", "info", "scan.db"]) == 0
    output = capsys.readouterr().out
    assert output.count("now\\n merge") == len(details)
    assert "\x1b" not in output
    output.encode()


def test_info_of_an_empty_file(tmp_path, capsys):
    ScanStore.create(tmp_path / "empty.db", SCENE).close()
    assert main(["scan", "info", str(tmp_path / "empty.db")]) == 0
    assert "no pairs" in capsys.readouterr().out


def test_list_shows_length_and_rate_of_each_sweep(scan, capsys):
    main(["scan", "drop-sweep", "scan.db", "5"])
    capsys.readouterr()
    assert main(["scan", "list", "scan.db"]) == 0
    rows = {cells[0]: cells for cells in map(str.split, capsys.readouterr().out.splitlines()) if cells}
    assert rows["sweep"][:4] == ["sweep", "pairs", "s", "pairs/s"]
    assert rows["2"] == ["2", "101", "5.0", "20", "50.0", "1.97", "0.0", "2.5", "50.0", "2.5", "1", "0"]
    assert rows["5"][-1] == "dropped"


def test_dropped_sweeps_can_be_restored(scan, capsys):
    assert main(["scan", "drop-sweep", "scan.db", "1", "3"]) == 0
    assert main(["scan", "drop-sweep", "scan.db", "2", "9"]) == 2
    assert "expected a sweep of 1 to 5, got 9" in capsys.readouterr().err
    with ScanStore.open(scan) as store:
        assert list(store.load().sweep_numbers) == [2, 4, 5]
    assert main(["scan", "drop-sweep", "scan.db", "1", "3", "--undo"]) == 0
    with ScanStore.open(scan) as store:
        assert list(store.load().sweep_numbers) == [1, 2, 3, 4, 5]


def test_merge_keeps_pairs_and_dropped_sweeps(scan, tmp_path, capsys):
    record(tmp_path / "other.db", lines=(0.001, 0.002), seed=1)
    main(["scan", "drop-sweep", "scan.db", "2"])
    assert main(["scan", "merge", "scan.db", "other.db", "-o", "both.db"]) == 0
    assert capsys.readouterr().out.endswith("both.db: 7 sweeps, 707 pairs\n")
    with (
        ScanStore.open("both.db") as both,
        ScanStore.open("scan.db") as one,
        ScanStore.open("other.db") as two,
    ):
        assert [s.number for s in both.sweeps()] == [1, 2, 3, 4, 5, 6, 7]
        assert [s.dropped for s in both.sweeps()] == [False, True, False, False, False, False, False]
        assert [s.gaps for s in both.sweeps()] == [0, 1, 2, 3, 4, 0, 1]
        expected = np.concatenate([one.load().strain, two.load().strain])
        np.testing.assert_array_equal(both.load().strain, expected)
        assert [detail["file"] for _, what, detail in both.history() if what == "merge"] == [
            "scan.db",
            "other.db",
        ]


def other_scene(path):
    record(path, scene=Scene("line", SCENE.axes[:1], (Phalanx("index", (0.0,)),)))


def other_bounds(path):
    record(path, scene=Scene("sheet", (Axis("x", 0.0, 0.06), SCENE.axes[1]), SCENE.phalanges))


def other_name(path):
    record(path, scene=Scene("snap", SCENE.axes, SCENE.phalanges))


def other_unit(path):
    record(path, unit="counts")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (other_scene, "other.db: expected axes x, y, found x"),
        (other_bounds, "other.db: expected upper bounds 0.05, 0.01, found 0.06, 0.01"),
        (other_name, f"other.db: expected name {SCENE.name}, found snap"),
        (other_unit, "other.db: expected strain in V, found counts"),
        (lambda path: None, "other.db: expected a scan file, found none"),
    ],
)
def test_files_of_different_scenes_are_not_merged(scan, tmp_path, capsys, make, message):
    make(tmp_path / "other.db")
    assert main(["scan", "merge", "scan.db", "other.db", "-o", "both.db"]) == 2
    assert message in capsys.readouterr().err
    assert sorted(path.name for path in tmp_path.iterdir() if "both" in path.name) == []


def test_an_exported_csv_imports_to_the_same_scan(scan, tmp_path):
    save_scene(SCENE, tmp_path / "scene.yaml")
    assert main(["scan", "export", "scan.db", "-o", "scan.csv"]) == 0
    assert main(["import", "csv", "scan.csv", "--scene", "scene.yaml", "-o", "again.db"]) == 0
    with ScanStore.open("scan.db") as one, ScanStore.open("again.db") as two:
        first, second = one.load(), two.load()
        for name in ("states", "strain", "sweep"):
            np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
        for a, b in zip(one.recording().sweeps, two.recording().sweeps, strict=True):
            np.testing.assert_array_equal(a.stamp_ns, b.stamp_ns)


def test_an_exported_npz_contains_pairs_and_scene(scan):
    main(["scan", "drop-sweep", "scan.db", "1"])
    assert main(["scan", "export", "scan.db", "-o", "scan.npz"]) == 0
    with ScanStore.open("scan.db") as store, np.load("scan.npz") as file:
        np.testing.assert_array_equal(file["strain"], store.load().strain)
        np.testing.assert_array_equal(np.unique(file["sweep"]), [2, 3, 4, 5])
        assert scene_from_dict(json.loads(str(file["scene"]))) == SCENE
        assert list(file["phalanges"]) == ["index", "middle"]


def simulated(feature: str) -> None:
    recorded = simulate_scan(feature, seed=1).to_scan()
    scene = Scene(
        feature,
        (Axis("x", -0.001, 0.0518), Axis("y", -0.001, 0.0518)),
        (Phalanx("index", (0.0, 0.0127)), Phalanx("middle", (0.0, -0.0127))),
    )
    with ScanStore.create(f"{feature}.db", scene) as store:
        for number in recorded.sweep_numbers:
            mine = recorded.sweep == number
            store.begin_sweep(int(number))
            store.append(np.flatnonzero(mine), recorded.states[mine], recorded.strain[mine])
            store.end_sweep()


def test_a_proposed_region_is_written_to_a_scene(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    simulated("bump")
    assert main(["scan", "region", "bump.db", "-o", "scene.yaml"]) == 0
    output = capsys.readouterr().out
    assert "proposed region of the feature" in output
    region = load_scene("scene.yaml").feature
    assert 0.01 < region.lower[0] < 0.02
    assert 0.04 < region.upper[0] < 0.0518
    assert f"feature: {{x: [{region.lower[0]:.4f}, {region.upper[0]:.4f}]" in output


def test_material_without_a_feature_has_no_region(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    simulated("none")
    assert main(["scan", "region", "none.db", "-o", "scene.yaml"]) == 0
    assert "no region" in capsys.readouterr().out
    assert not (tmp_path / "scene.yaml").exists()


def test_textured_material_has_no_region(tmp_path, monkeypatch, capsys):
    """A weave of 1 V with one coarser patch: its place can be printed outside the patch as well."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(1)
    x = np.linspace(0.0, 0.6, 1500)
    weave = np.sin(x[:, None] * rng.uniform(60, 200, 8) + rng.uniform(0, 6, 8))
    weave[(x > 0.2) & (x < 0.25)] *= 12.0
    scene = Scene("weave", (Axis("x", 0.0, 0.6),), (Phalanx("index", (0.0,)),))
    with ScanStore.create("weave.db", scene) as store:
        for _ in range(3):
            store.begin_sweep()
            felt = weave + 0.02 * rng.standard_normal(weave.shape)
            store.append(np.arange(len(x)), x[:, None], felt)
            store.end_sweep()
    assert main(["scan", "region", "weave.db", "-o", "scene.yaml"]) == 0
    assert "no region found" in capsys.readouterr().out
    assert not (tmp_path / "scene.yaml").exists()


def test_plot_draws_every_figure(scan, capsys):
    assert main(["scan", "plot", "scan.db", "-o", "figures", "--dpi", "30"]) == 0
    drawn = capsys.readouterr().out.split()
    assert {"figures/map_index.png", "figures/region.png"} <= set(drawn)
    for name in drawn:
        assert (scan.parent / name).read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("info none.db", "none.db: expected a scan file, found none"),
        ("list scan.txt", "scan.txt: expected a scan file, file is not a database"),
        ("export scan.db -o scan.doc", "scan.doc: expected the extension .csv or .npz"),
        (
            "export empty.db -o empty.npz",
            "empty.db: expected at least one state-measurement pair",
        ),
        ("export scan.db -o none/scan.csv", "none/scan.csv: expected a writable file, No such file"),
        ("plot scan.db -o scan.txt", "scan.txt: expected a folder for the figures"),
        ("merge scan.db -o scan.db", "scan.db: expected no file of this name, found one"),
    ],
)
def test_mistakes_are_refused_in_one_line(scan, capsys, arguments, message):
    (scan.parent / "scan.txt").write_text("no scan " * 100)
    with ScanStore.open(scan) as store:
        ScanStore.create(scan.parent / "empty.db", store.scene).close()
    assert main(["scan", *arguments.split()]) == 2
    printed = capsys.readouterr().err
    assert message in printed
    assert printed.count("\n") == 1
