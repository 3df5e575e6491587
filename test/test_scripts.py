"""The scripts behind `make`: which Python they take, which tests they choose, what they say was skipped."""

import os
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

PYTHON = """#!/bin/bash
# A python3 of another version, as far as it says itself; it makes no environment
case "$1" in
--version) echo "Python {major}.{minor}.0" ;;
-c) exec {python} -c "import sys, sysconfig
sys.version_info, sys.executable = ({major}, {minor}, 0, 'final', 0), '$0'
$2" ;;
*) echo "python3 $*"; exit 9 ;;
esac
"""


def run(*command: str | Path, folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    kept = {"HOME": os.environ["HOME"], "PATH": os.environ["PATH"]}
    return subprocess.run(
        list(map(str, command)),
        cwd=folder,
        env={**kept, **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
        timeout=300,
    )


def programs(folder: Path, texts: Mapping[str, str]) -> str:
    """PATH with these programs before the others."""
    folder.mkdir(parents=True)
    for name, text in texts.items():
        (folder / name).write_text(text)
        (folder / name).chmod(0o755)
    return f"{folder}:{os.environ['PATH']}"


@pytest.mark.parametrize(
    ("version", "sourced", "said"),
    [
        ((3, 14), True, "python3 -m venv --system-site-packages"),
        ((3, 99), True, "python3 -m venv --system-site-packages"),
        ((3, 9), True, "setup: Python: expected 3.10 or later, found Python 3.9.0"),
        ((3, 13), False, "python3 -m venv"),
        (
            (3, 14),
            False,
            "setup: Python: expected 3.10 to 3.13, for which there are ROS 2 wheels, found Python 3.14.0",
        ),
    ],
)
def test_a_sourced_ros_brings_its_own_python_and_wheels_end_at_3_13(
    tmp_path: Path, version: tuple[int, int], sourced: bool, said: str
) -> None:
    for name in ("scripts", "requirements"):
        shutil.copytree(ROOT / name, tmp_path / name)
    major, minor = version
    stub = PYTHON.format(major=major, minor=minor, python=Path(sys.executable).resolve())
    others = dict.fromkeys((f"python3.{one}" for one in range(10, 15)), "#!/bin/sh\nexit 127\n")
    path = programs(tmp_path / "bin", {"python3": stub, **others, "cmake": "", "c++": "", "git": ""})
    (tmp_path / "ros/rclpy").mkdir(parents=True)
    (tmp_path / "ros/rclpy/__init__.py").touch()
    ros = {"AMENT_PREFIX_PATH": str(tmp_path), "PYTHONPATH": str(tmp_path / "ros"), "ROS_DISTRO": "lyrical"}
    made = run("bash", "scripts/setup_venv", folder=tmp_path, PATH=path, **(ros if sourced else {}))
    assert made.returncode != 0
    assert said in made.stdout.splitlines()[-1]


PIP = """#!/bin/bash
# A Python whose pip knows an index without uv, or from which uv reads nothing
echo "$*" >>calls
[[ "$*" != *{fails}* ]]
"""


@pytest.mark.parametrize(
    ("flavor", "fails", "by"),
    [
        ("kilted", "uv==", "pip"),
        ("kilted", "-m uv pip", "pip"),
        ("kilted", "nothing", "uv"),
        ("system", "nothing", "pip"),
    ],
)
def test_pip_makes_the_environment_where_uv_cannot_or_would_not_see_a_sourced_ros(
    tmp_path: Path, flavor: str, fails: str, by: str
) -> None:
    for name in ("scripts", "requirements"):
        shutil.copytree(ROOT / name, tmp_path / name)
    cmake = tmp_path / f".venv-{flavor}/share/rosidl_generator_py/cmake"
    cmake.mkdir(parents=True)
    (cmake / "rosidl_generator_py_generate_interfaces.cmake").touch()
    programs(tmp_path / f".venv-{flavor}/bin", {"python": PIP.format(fails=f'"{fails}"')})
    path = programs(tmp_path / "bin", {"cmake": "", "c++": "", "git": ""})
    (tmp_path / "ros/rclpy").mkdir(parents=True)
    (tmp_path / "ros/rclpy/__init__.py").touch()
    sourced = {"AMENT_PREFIX_PATH": str(tmp_path), "PYTHONPATH": str(tmp_path / "ros")}
    ros = sourced if flavor == "system" else {}
    made = run("bash", "scripts/setup_venv", folder=tmp_path, PATH=path, ROS_DISTRO="kilted", **ros)
    assert made.returncode == 0, made.stdout
    calls = (tmp_path / "calls").read_text().splitlines()
    last = next(call for call in reversed(calls) if "install" in call)
    assert last.startswith(f"-m {by} ")
    assert "-rrequirements/runtime.txt" in last


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """A repository with the folders of rooms, on a branch of main."""
    git = ("git", "-c", "user.name=a", "-c", "user.email=a@b")
    shutil.copytree(ROOT / "scripts", tmp_path / "scripts")
    for room in ("core", "io", "ros", "cli"):
        for folder in (tmp_path / "tactile_localizer" / room, tmp_path / "test" / room):
            folder.mkdir(parents=True)
            (folder / "a.py").write_text("a = 1\n")
    for command in (("init", "--quiet", "-b", "main"), ("add", "."), ("commit", "--quiet", "-m", "a")):
        subprocess.run([*git, *command], cwd=tmp_path, check=True)
    subprocess.run([*git, "switch", "--quiet", "-c", "mine"], cwd=tmp_path, check=True)
    return tmp_path


@pytest.mark.parametrize(
    ("changed", "rooms"),
    [
        ("tactile_localizer/core/a.py", "core io paper streams"),
        ("tactile_localizer/core/new.py", "core io paper streams"),
        ("tactile_localizer/io/a.py", "io"),
        ("test/cli/a.py", "cli"),
        ("tactile_localizer/scene.py", "core io paper streams"),
        ("README.md", "core io paper streams"),
    ],
)
def test_fast_tests_are_those_of_the_rooms_that_changed(clone: Path, changed: str, rooms: str) -> None:
    (clone / changed).write_text("a = 2\n")
    git = ("git", "-c", "user.name=a", "-c", "user.email=a@b")
    for is_committed in (False, True):
        if is_committed:
            subprocess.run([*git, "add", "."], cwd=clone, check=True)
            subprocess.run([*git, "commit", "--quiet", "-m", "b"], cwd=clone, check=True)
        assert run("scripts/changed_rooms", folder=clone).stdout.split() == [
            f"test/{room}" for room in rooms.split()
        ]


def test_without_git_all_fast_tests_run(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "scripts", tmp_path / "scripts")
    rooms = run("scripts/changed_rooms", folder=tmp_path).stdout.split()
    assert rooms == ["test/core", "test/io", "test/paper", "test/streams"]


@pytest.mark.parametrize(
    ("absent", "said"),
    [
        ((), ""),
        (("linux.uml", "insmod"), "CAN sockets; they run after: sudo apt-get install user-mode-linux kmod\n"),
        (("chromium",), "reports in a browser; they run after: sudo apt-get install chromium\n"),
        (
            ("ip", "chromium"),
            "CAN sockets and reports in a browser; they run after: sudo apt-get install iproute2 chromium\n",
        ),
    ],
)
def test_what_apt_would_have_to_install_is_said_in_one_line(
    tmp_path: Path, absent: tuple[str, ...], said: str
) -> None:
    present = {"linux.uml", "insmod", "ip", "chromium"} - {*absent}
    programs(tmp_path / "bin", dict.fromkeys(present, "#!/bin/sh\n"))
    text = (ROOT / "test/skipped").read_text().replace("$PATH:/usr/sbin:/sbin", str(tmp_path / "bin"))
    found = run(shutil.which("bash") or "bash", "-c", text, folder=tmp_path)
    assert (found.returncode, found.stdout) == (0, said and f"skipped: tests of {said}")
