"""Readers and models of other packages are found by their entry points, as docs/plugins.md describes."""

import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import venv
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tactile_localizer.cli import main
from tactile_localizer.io.scans.folder import ScanFolder
from tactile_localizer.io.scene_file import load_scene

ROOT = Path(__file__).parents[1]
Run = Callable[[str], tuple[int, str, str]]

SECOND = """
[tool.setuptools]
py-modules = ["skin_second"]

[project]
name = "skin-second"
version = "1.0"

[project.entry-points."tactile_localizer.readers"]
".npz" = "skin_second:read"
".gone" = "skin_second:gone"
".raises" = "skin_second:raises"
".exits" = "skin_second:exits"
".list" = "skin_second:listed"
".narrow" = "skin_second:narrow"
".seconds" = "skin_second:seconds"

[project.entry-points."tactile_localizer.models"]
nearest = "skin_second:Model"
gone = "skin_second:Gone"
nowhere = "skin_third:Model"
"""

FAULTY = """
import numpy as np
from tactile_localizer import RecordedSweep, Recording

def raises(path, scene):
    raise KeyError("t_us")

def exits(path, scene):
    raise SystemExit(3)

def listed(path, scene):
    return []

def of(path, stamp_ns, channels):
    sweep = RecordedSweep(1, stamp_ns, np.zeros((3, 2)), np.zeros((3, channels)), np.zeros((3, 2), int))
    return Recording(str(path), [sweep])

def narrow(path, scene):
    return of(path, np.arange(3), 5)

def seconds(path, scene):
    return of(path, 0.1 * np.arange(3), 16)
"""


def block(first: str) -> str:
    """The code on the page of plug-ins that begins with a line."""
    found = re.findall(r"(?:^(?:    .*)?\n)+", (ROOT / "docs/plugins.md").read_text(), re.MULTILINE)
    (code,) = (each for each in found if each.lstrip("\n").startswith(f"    {first}"))
    return re.sub("^    ", "", code, flags=re.MULTILINE)


def package(folder: Path, project: str, modules: Mapping[str, str]) -> Path:
    """The wheel of a package."""
    folder.mkdir(parents=True)
    (folder / "pyproject.toml").write_text(project)
    for name, code in modules.items():
        (folder / f"{name}.py").write_text(code)
    code = f"import setuptools.build_meta as build; build.build_wheel({str(folder)!r})"
    subprocess.run([sys.executable, "-c", code], cwd=folder, check=True, capture_output=True, timeout=900)
    return next(folder.glob("*.whl"))


def environment(folder: Path, *wheels: Path) -> Path:
    """The Python of a virtual environment with our package, what it needs, and wheels."""
    venv.create(folder, symlinks=True)
    site = Path(sysconfig.get_path("purelib", "venv" if os.name == "posix" else None, {"base": str(folder)}))
    (site / "ours.pth").write_text(f"{ROOT}\n{sysconfig.get_path('purelib')}\n")
    for wheel in wheels:
        shutil.unpack_archive(wheel, site, "zip")
    return folder / "bin/python"


def runner(python: Path, folder: Path) -> Run:
    """Function that runs our command there without PYTHONPATH; returns status, output and errors."""

    def run(arguments: str) -> tuple[int, str, str]:
        without = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
        done = subprocess.run(
            [python, ROOT / "scripts/tactile-localizer", *arguments.split()],
            cwd=folder,
            env=without,
            capture_output=True,
            text=True,
            timeout=900,
            check=False,
        )
        return done.returncode, done.stdout, done.stderr

    return run


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short simulated scan and test, as CSV and as the files of the page."""
    folder = tmp_path_factory.mktemp("recordings")
    assert main(f"simulate bump -o {folder} --train 1 --test 1".split()) == 0
    scene = load_scene(ROOT / "config/scenes/bump.yaml")
    for name in ("train", "test"):
        rows = np.genfromtxt(folder / f"{name}.csv", delimiter=",", names=True)
        strain = [rows[f"{each.name}_{n + 1}"] for each in scene.phalanges for n in range(each.channels)]
        np.savez(
            folder / f"{name}.npz",
            t_us=np.rint(1e6 * rows["stamp_s"]).astype(int),
            palm=np.column_stack([rows[axis] for axis in scene.axis_names]),
            strain=np.column_stack(strain),
        )
    return folder


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of the page's package."""
    modules = {
        "skin_npz": block("import numpy"),
        "nearest_student": (ROOT / "examples/own_model/nearest_student.py").read_text(),
    }
    return package(tmp_path_factory.mktemp("page") / "package", block("[project]"), modules)


@pytest.fixture(scope="module")
def run(folder: Path, page: Path, tmp_path_factory: pytest.TempPathFactory) -> Run:
    return runner(environment(tmp_path_factory.mktemp("one") / "venv", page), folder)


@pytest.fixture(scope="module")
def run_with_faulty(folder: Path, page: Path, tmp_path_factory: pytest.TempPathFactory) -> Run:
    made = tmp_path_factory.mktemp("two")
    faulty = package(made / "package", SECOND, {"skin_second": FAULTY})
    return runner(environment(made / "venv", page, faulty), folder)


def updates(path: Path) -> list[dict[str, Any]]:
    """The estimates of a replay, without the numbers of the sweeps."""
    return [{**each, "sweep": 0} for each in json.loads(path.read_text())["updates"]]


@pytest.fixture(scope="module")
def scan(folder: Path, run: Run) -> str:
    """A scan imported by the page's reader."""
    status, printed, error = run("import npz train.npz --scene bump.yaml -o npz_scan")
    assert status == 0, error
    assert "npz_scan: 1 sweep" in printed
    return "npz_scan"


def test_a_reader_of_another_package_imports_what_its_file_holds(folder: Path, scan: str) -> None:
    (sweep,) = ScanFolder(folder / scan).recording().sweeps
    with np.load(folder / "train.npz") as file:
        np.testing.assert_array_equal(sweep.stamp_ns, 1000 * file["t_us"])
        np.testing.assert_array_equal(sweep.position, file["palm"])
        np.testing.assert_array_equal(sweep.strain, file["strain"])
    assert ScanFolder(folder / scan).history()[0]["what"] == "import npz"


def test_a_replay_of_another_packages_file_is_that_of_the_csv(folder: Path, run: Run, scan: str) -> None:
    """Of samples of which one lacks a value."""
    header, *rows = (folder / "test.csv").read_text().splitlines()
    row = rows[200].split(",")
    row[header.split(",").index("index_4")] = ""
    (folder / "holes.csv").write_text("\n".join([header, *rows[:200], ",".join(row), *rows[201:]]) + "\n")
    with np.load(folder / "test.npz") as file:
        arrays = dict(file)
    arrays["strain"][200, 3] = np.nan
    np.savez(folder / "holes.npz", **arrays)
    for kind in ("npz", "csv"):
        status, _, error = run(f"replay holes.{kind} --scan {scan} --config fast --json {kind}.json")
        assert status < 2, error
    assert updates(folder / "npz.json") == updates(folder / "csv.json") != []


def test_a_model_of_another_package_has_a_name(run: Run, scan: str) -> None:
    status, printed, error = run(f"replay test.npz --scan {scan} --config fast --model nearest")
    assert status < 2, error
    assert "\nnearest, grid filter" in printed


def test_sweeps_are_detected_in_what_another_package_reads(folder: Path, run: Run) -> None:
    with np.load(folder / "train.npz") as file:
        slid = {name: array[::16] for name, array in file.items()}
    rested = {
        name: np.concatenate([array, np.repeat(array[-1:], 40, axis=0)]) for name, array in slid.items()
    }
    rested["t_us"] = 80_000 * np.arange(1, 1 + len(rested["palm"]))
    rested["strain"][7, 3] = rested["palm"][9, 0] = np.nan
    np.savez(folder / "rested.npz", **rested)
    status, printed, error = run(
        "import npz rested.npz --scene bump.yaml --detect-sweeps both_ways -o slid_scan"
    )
    assert status == 0, error
    assert "samples are in no detected sweep" in printed
    (sweep,) = ScanFolder(folder / "slid_scan").recording().sweeps
    left_out = {*(1000 * rested["t_us"][[7, 9, -1]]).tolist()}  # no strain, no position, at rest
    assert not left_out & {*sweep.stamp_ns.tolist()}
    assert len(sweep) > len(slid["palm"]) // 2


@pytest.mark.parametrize(
    ("command", "reason"),
    [
        ("replay test.foo", r"test\.foo: expected a folder, or a file of \.asc, .*\.npz, .*found \.foo"),
        ("replay test.npz", r"readers \.npz: expected one package .*, found skin-npz, skin-second; uninst"),
        ("import npz train.npz --scene bump.yaml -o a_scan", r"found skin-npz, skin-second; uninstall"),
        ("replay test.gone", r"test\.gone: reader skin_second:gone of skin-second: .* no attribute 'gone'"),
        ("replay test.raises", r"skin-second: expected a recording, KeyError: 't_us' \(skin_second\.py:6\)"),
        ("replay test.exits", r"skin-second: expected a recording, SystemExit: 3"),
        ("replay test.list", r"skin-second: expected a Recording, got list"),
        ("replay test.narrow", r"strain: expected float64 of shape \(3, 16\), got float64 of shape \(3, 5\)"),
        ("replay test.seconds", r"stamp_ns: expected int64 of shape \(3,\), got float64"),
        ("replay test.csv --model nearest", r"models nearest: expected one package .*skin-npz, skin-second"),
        ("replay test.csv --model gone", r"model 'gone': expected a class Gone in skin_second, found None"),
        ("replay test.csv --model nowhere", r"model 'nowhere': .* No module named 'skin_third'"),
        ("replay test.csv --model neares", r"expected sweep_mixture, gone, nearest, .*mean nearest"),
    ],
)
def test_a_faulty_package_is_an_error_in_one_line(
    folder: Path, run_with_faulty: Run, scan: str, command: str, reason: str
) -> None:
    if not (folder / command.split()[1]).exists():
        (folder / command.split()[1]).touch()
    more = f" --scan {scan} --config fast" if command.startswith("replay") else ""
    status, _, error = run_with_faulty(command + more)
    assert status == 2
    assert error.count("\n") == 1
    assert re.match(r"error: ", error)
    assert re.search(reason, error), error
