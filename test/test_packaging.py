"""The two ways in, rosdep with colcon and pip, say the same."""

from __future__ import annotations

import re
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
    assert f"\n{__version__} (" in (ROOT / "CHANGELOG.rst").read_text()


def test_rosdep_and_pip_ask_for_the_same_libraries() -> None:
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


def test_every_requirement_has_a_floor_and_a_ceiling() -> None:
    for file in ("runtime.txt", "build.txt", "dev.txt", "bench.txt"):
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
