"""Packaging for rosdep with colcon, and for pip, is consistent."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from tactile_localizer import __version__

ROOT = Path(__file__).parents[1]
PACKAGE_XML = ElementTree.parse(ROOT / "package.xml").getroot()

ROSDEP_KEYS = {
    "cantools": "python3-cantools-pip",
    "joblib": "python3-joblib",
    "matplotlib": "python3-matplotlib",
    "msgpack": "python3-msgpack",
    "numpy": "python3-numpy",
    "python-can": "python3-can",
    "pyyaml": "python3-yaml",
    "rich": "python3-rich",
    "rosbags": "python3-rosbags-pip",
    "scipy": "python3-scipy",
}

ROS_PACKAGE = r"\w+_(msgs|srvs|interfaces)|rclpy|launch|launch_ros|ament_index_python|tf2_\w+"


def requirements(file: str) -> list[str]:
    lines = (ROOT / "requirements" / file).read_text().splitlines()
    return [line for line in lines if line and not line.startswith("#")]


def test_the_version_is_the_same_everywhere() -> None:
    assert PACKAGE_XML.findtext("version") == __version__
    changelog = (ROOT / "CHANGELOG.rst").read_text()
    assert "\nForthcoming\n---" in changelog or f"\n{__version__} (" in changelog


def test_rosdep_and_pip_require_the_same_libraries() -> None:
    by_pip = {ROSDEP_KEYS[re.split(r"[<>=]", line)[0]] for line in requirements("runtime.txt")}
    by_rosdep = {depend.text for depend in PACKAGE_XML.iter("exec_depend")}
    assert by_pip == {key for key in by_rosdep if key is not None and key.startswith("python3-")}


def test_every_ros_package_that_is_imported_is_declared() -> None:
    sources = [*(ROOT / "tactile_localizer").rglob("*.py"), *(ROOT / "launch").glob("*.py")]
    lines = re.compile(r"^\s*(?:from|import) (\w+)", re.MULTILINE)
    imported = {name for path in sources for name in lines.findall(path.read_text(encoding="utf-8"))}
    ros = {name for name in imported if re.fullmatch(ROS_PACKAGE, name)}
    declared = {depend.text for kind in ("depend", "exec_depend") for depend in PACKAGE_XML.iter(kind)}
    assert "rclpy" in ros
    assert ros <= declared
    by_name = {"tf2_msgs"}  # imported where a parameter asks for tf
    assert {name for name in declared if name and name.endswith(("_msgs", "_srvs"))} <= ros | by_name


def test_every_requirement_has_a_lower_and_an_upper_bound() -> None:
    for file in ("runtime.txt", "build.txt", "dev.txt", "bench.txt", "cluster.txt"):
        for line in requirements(file):
            assert re.search(r"==|>=.+,<", line), f"{file}: {line}"


@pytest.mark.parametrize("distribution", ["jazzy", "kilted"])
def test_ros_wheels_are_pinned(distribution: str) -> None:
    lines = requirements(f"ros-{distribution}.txt")
    assert f"ros-{distribution}-rclpy" in {line.split("==")[0] for line in lines}
    assert [line for line in lines if not re.fullmatch(r"[a-z0-9-]+==[0-9.]+", line)] == []


def test_every_executable_script_is_installed() -> None:
    scripts = {path.name for path in (ROOT / "scripts").glob("*_node")}
    installed = set(re.findall(r"scripts/(\w+_node)", (ROOT / "CMakeLists.txt").read_text()))
    assert scripts == installed


@pytest.mark.slow
def test_a_wheel_from_the_sdist_replays_without_ros(tmp_path: Path) -> None:
    source = tmp_path / "source"
    source.mkdir()
    for name in ("tactile_localizer", "config", "msg", "requirements"):
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "setup.py", "MANIFEST.in", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)

    def built(what: str, where: Path) -> Path:
        code = f"import setuptools.build_meta as build; build.build_{what}({str(tmp_path)!r})"
        subprocess.run([sys.executable, "-c", code], cwd=where, check=True, capture_output=True, timeout=900)
        return next(tmp_path.glob({"sdist": "*.tar.gz", "wheel": "*.whl"}[what]))

    shutil.unpack_archive(built("sdist", source), tmp_path / "unpacked")
    wheel = built("wheel", next((tmp_path / "unpacked").iterdir()))
    shutil.unpack_archive(wheel, tmp_path / "installed", "zip")

    code = """if True:
        import sys
        from tactile_localizer.cli import main
        assert main("simulate bump --test 1 -o .".split()) == 0
        assert main("import csv train.csv --scene bump.yaml -o bump_scan".split()) == 0
        assert main("replay test.csv --scan bump_scan --seed 1".split()) == 0
        ros = [name for name in sys.modules if name.split(".")[0] in ("rclpy", "launch", "std_msgs")]
        assert ros == [], ros
        print(sys.modules["tactile_localizer"].__file__)
    """
    environment = {name: value for name, value in os.environ.items() if name != "AMENT_PREFIX_PATH"}
    environment["PYTHONPATH"] = str(tmp_path / "installed")
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=900,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.splitlines()[-1].startswith(str(tmp_path / "installed"))
    assert "1 of 1 sweeps converged" in done.stdout
