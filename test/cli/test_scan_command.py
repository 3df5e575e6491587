"""The command `scan`."""

import json

import numpy as np
import pytest
from support.learned import unexamined

from tactile_localizer import __version__
from tactile_localizer.cli import main
from tactile_localizer.io.recording import RecordedSweep
from tactile_localizer.io.scans import FORMAT
from tactile_localizer.io.scans.writer import ScanWriter
from tactile_localizer.scene import Axis, Phalanx, Scene

SCENE = Scene(
    "sheet",
    (Axis("x", 0.0, 0.05), Axis("y", 0.0, 0.01)),
    (Phalanx("index", (0.0, 0.01)), Phalanx("middle", (0.0, -0.01))),
)


def record(path, scene=SCENE, unit="V"):
    rng = np.random.default_rng(0)
    x = np.linspace(0, 0.05, 101)
    with ScanWriter(path, scene) as writer:
        for number, y in enumerate((0.0, 0.0025, 0.005, 0.0075, 0.01), start=1):
            stamp_ns = 1_700_000_000_000_000_000 + number * 10**10 + np.arange(len(x)) * 50_000_001
            states = np.column_stack([x, np.full_like(x, y)])
            strain = rng.normal(size=(len(x), 8 * len(scene.phalanges)))
            pairs = stamp_ns, states, strain, strain[:, :1]
            writer.add(RecordedSweep(number, *pairs, gaps=number, strain_unit=unit))
        writer.note("test", files=["a\nb.csv"], notes=["one \x1b[31mnote"])


@pytest.fixture
def scan(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("tactile_localizer.io.scans.learned.learn_model", unexamined)
    record(tmp_path / "bump_scan")
    (tmp_path / "bump_scan/dropped").mkdir()
    (tmp_path / "bump_scan/sweep_0002.npy").rename("bump_scan/dropped/sweep_0002.npy")
    (tmp_path / "bump_scan/sweep_0004.npy").unlink()
    (tmp_path / "bump_scan/sweep_0004.npy").mkdir()
    return tmp_path / "bump_scan"


def test_info_prints_totals_history_and_findings(scan, capsys):
    assert main(["scan", "info", "bump_scan"]) == 0
    output, logged = capsys.readouterr()
    assert "sweep_0004" not in logged, "it is among the findings"
    assert output.startswith("bump_scan: 303 pairs in 3 sweeps (1 dropped)\n")
    for text in (
        "sheet: x 0 to 0.05, y 0 to 0.01",
        "index (8 channels), middle (8 channels), strain in V",
        "1700000010.0 to 1700000055.0 s",
        rf"test: version {__version__}, format {FORMAT}, files ['a\nb.csv']",
        r"one \x1b[31mnote",
        "sweep_0004.npy: could not be read, found a directory; the sweep is not used",
    ):
        assert text in output


def test_standard_output_may_have_the_json_alone(scan, capsys):
    assert main(["scan", "info", "bump_scan", "--json", "-"]) == 0
    printed = capsys.readouterr()
    assert any("sweep_0004.npy" in each for each in json.loads(printed.out)["findings"])
    assert "bump_scan: 303 pairs in 3 sweeps" in printed.err
    assert not (scan.parent / "-").exists()


def test_names_are_drawn_literally(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    finger = "[/index] $\\frac"
    record(tmp_path / "scan", Scene("$x_{", SCENE.axes, (Phalanx(finger, (0.0, 0.01)),)), unit="$[/V]")
    assert main(["scan", "plot", "scan", "-o", "out"]) == 0
    assert (tmp_path / "out" / "map_[_index] $\\frac.png").read_bytes().startswith(b"\x89PNG")
    assert capsys.readouterr().out == "out/map_[_index] $\\frac.png\n"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("info none", "none: expected a scan folder, found none"),
        ("info scan.txt", "scan.txt: expected a scan folder, found none (with"),
        ("plot bump_scan -o scan.txt", "scan.txt/map_index.png: could not be written, Not a directory"),
        ("plot empty", "empty: expected at least one state-measurement pair"),
    ],
)
def test_mistakes_are_refused_in_one_line(scan, capsys, arguments, message):
    (scan.parent / "scan.txt").write_text("no scan " * 100)
    ScanWriter(scan.parent / "empty", SCENE).close()
    assert main(["scan", *arguments.split()]) == 2
    printed = capsys.readouterr().err
    assert message in printed
    assert printed.count("\n") == 1
    assert main(["scan", "info", "empty"]) == 0
    assert "no pairs" in capsys.readouterr().out
