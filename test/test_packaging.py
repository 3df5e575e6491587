"""Packaging for rosdep with colcon, and for pip, is consistent."""

import ast
import gzip
import json
import os
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from pathlib import Path

import pytest
import yaml

from tactile_localizer.cli import COMMANDS, main

ROOT = Path(__file__).parents[1]
PACKAGE_XML = ElementTree.parse(ROOT / "package.xml").getroot()

ROSDEP_KEYS = {
    "cantools": "python3-cantools-pip",
    "numpy": "python3-numpy",
    "python-can": "python3-can",
    "pyyaml": "python3-yaml",
    "scipy": "python3-scipy",
}

EXTRAS = ("argcomplete", "distributed", "jinja2", "joblib", "matplotlib", "mcap", "msgpack", "rosbags")

ROS_PACKAGE = r"\w+_(msgs|srvs|interfaces)|rclpy|launch|launch_ros|ament_index_python|tf2_\w+"


def requirements(file: str) -> list[str]:
    lines = (ROOT / "requirements" / file).read_text().splitlines()
    return [line for line in lines if line and not line.startswith("#")]


def test_a_release_changes_the_version_in_one_place(tmp_path: Path) -> None:
    shutil.copy(ROOT / "package.xml", tmp_path)
    changes = (ROOT / "CHANGELOG.rst").read_text()
    if "\nForthcoming\n" not in changes:  # this is a release
        changes = changes.replace("\n\n", "\n\nForthcoming\n-----------\n* A change.\n\n", 1)
    (tmp_path / "CHANGELOG.rst").write_text(changes)
    shutil.copytree(ROOT / "tactile_localizer", tmp_path / "tactile_localizer")

    def run(*command: str) -> str:
        who = {f"GIT_{role}_{what}": "a@b" for role in ("AUTHOR", "COMMITTER") for what in ("NAME", "EMAIL")}
        environment = {**os.environ, **who, "PYTHONPATH": "", "GIT_CONFIG_GLOBAL": os.devnull}
        return subprocess.run(
            command, cwd=tmp_path, env=environment, check=True, capture_output=True, text=True, timeout=900
        ).stdout

    run("git", "init", "--quiet")
    run("git", "add", "package.xml", "CHANGELOG.rst")
    run("git", "commit", "--quiet", "--message", "before")
    run("catkin_prepare_release", "--version", "9.0.0", "--no-push", "--non-interactive")
    show = "from tactile_localizer import __version__; print(__version__)"
    assert run(sys.executable, "-c", show) == "9.0.0\n"
    assert "\n9.0.0 (" in (tmp_path / "CHANGELOG.rst").read_text()
    assert run("git", "tag") == "9.0.0\n"


def files_with(text: str) -> set[str]:
    """Files of the repository, but pages and pinned libraries, in which a text stands."""
    if not (ROOT / ".git").exists():
        pytest.skip("the source tree is no git checkout")
    command = ["git", "grep", "--files-with-matches", "--word-regexp", "--fixed-strings", text, "--"]
    found = subprocess.run(
        [*command, ".", ":!docs", ":!requirements", ":!CHANGELOG.rst"],
        cwd=ROOT,
        check=False,
        capture_output=True,
        text=True,
    )
    return set(found.stdout.split())


def test_the_version_stands_in_one_file() -> None:
    assert files_with(PACKAGE_XML.findtext("version", "none")) == {"package.xml"}


def test_maintainer_and_repository_are_placeholders_in_one_file() -> None:
    assert files_with("tactile-localizer.invalid") == {"package.xml", "test/test_packaging.py"}


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


def test_hooks_and_checks_have_the_same_formatter() -> None:
    (local,) = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())["repos"]
    needed = {library for hook in local["hooks"] for library in hook["additional_dependencies"]}
    assert {library for library in needed if library.startswith("ruff")} <= set(requirements("dev.txt"))
    assert all("==" in library for library in needed)


def test_forms_and_workflows_are_valid_yaml() -> None:
    files = [*(ROOT / ".github").rglob("*.yml"), ROOT / "CITATION.cff"]
    assert {file.name for file in files} > {"ci.yml", "bug.yml", "CITATION.cff"}
    assert all(isinstance(yaml.safe_load(file.read_text()), dict) for file in files)


def test_every_requirement_has_a_lower_and_an_upper_bound() -> None:
    for file in (ROOT / "requirements").iterdir():
        for line in requirements(file.name):
            assert re.search(r"==|>=.+,<", line), f"{file.name}: {line}"


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The content of a wheel that is built from an sdist."""
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    for name in ("tactile_localizer", "config", "msg", "requirements", "src"):
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "setup.py", "package.xml", "MANIFEST.in", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)

    def built(what: str, where: Path) -> Path:
        code = f"import setuptools.build_meta as build; build.build_{what}({str(folder)!r})"
        subprocess.run([sys.executable, "-c", code], cwd=where, check=True, capture_output=True, timeout=900)
        return next(folder.glob({"sdist": "*.tar.gz", "wheel": "*.whl"}[what]))

    shutil.unpack_archive(built("sdist", source), folder / "unpacked")
    wheel = built("wheel", next((folder / "unpacked").iterdir()))
    shutil.unpack_archive(wheel, folder / "installed", "zip")
    return folder / "installed"


def run_without(libraries: Sequence[str], package: Path, folder: Path, *commands: str) -> list[str]:
    """Run subcommands where neither ROS nor some libraries are installed; the last line is their status.

    Parameters
    ----------
    libraries : names of the libraries
    package : folder that the package is in
    folder : working directory
    commands : command lines without the name of the program
    """
    code = (
        f"import sys; sys.modules.update(dict.fromkeys({[*libraries, 'rclpy']!r}))\n"
        "from tactile_localizer.cli import main\n"
        "def status(command):\n"
        "    try: return main(command.split())\n"
        "    except SystemExit as end: return end.code\n"
        f"print([status(command) for command in {commands!r}])"
    )
    environment = {name: value for name, value in os.environ.items() if name != "AMENT_PREFIX_PATH"}
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=folder,
        env={**environment, "PYTHONPATH": str(package)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=True,
        timeout=900,
    )
    return done.stdout.splitlines()


def test_a_wheel_has_every_file_of_the_package(installed: Path) -> None:
    package = ROOT / "tactile_localizer"
    own = {path.relative_to(ROOT) for path in package.rglob("*") if path.is_file() and path.suffix != ".pyc"}
    assert {path for path in own if not (installed / path).exists()} == set()


def test_without_a_compiler_a_wheel_leaves_its_work_to_numpy(installed: Path, tmp_path: Path) -> None:
    plain, source = tmp_path / "plain", installed.parent / "source"

    def run(code: str, folder: Path, **variables: str) -> str:
        command, environment = [sys.executable, "-c", code], {**os.environ, **variables}
        return subprocess.run(
            command, cwd=folder, env=environment, check=True, capture_output=True, text=True, timeout=900
        ).stdout

    shutil.copytree(source, tmp_path / "source")
    build = f"import setuptools.build_meta as build; build.build_wheel({str(tmp_path)!r})"
    run(build, tmp_path / "source", CC="false")
    shutil.unpack_archive(next(tmp_path.glob("*.whl")), plain, "zip")
    code = "from tactile_localizer.core import compiled; print(compiled.MODULE)"
    assert "_compiled" in run(code, tmp_path, PYTHONPATH=str(installed))
    assert run(code, tmp_path, PYTHONPATH=str(plain)) == "None\n"


def test_a_wheel_without_extras_finds_what_the_source_tree_finds(
    installed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recording = ROOT / "examples/recordings/engine_bump"
    of_wheel, of_source = tmp_path / "wheel", tmp_path / "source"
    for folder in (of_wheel, of_source):
        folder.mkdir()
        for name in ("train", "test"):
            with gzip.open(recording / f"{name}.csv.gz", "rt") as file:
                header, *rows = file
            first = [row for row in rows if row.split(",")[1] == "0"]
            (folder / f"{name}.csv").write_text("".join([header, *first]))
    commands = (
        f"import csv train.csv --scene {recording}/scene.yaml -o scan",
        "replay test.csv --scan scan --seed 1 --json replay.json",
    )
    trade = "tradeoff test.csv --scan scan --configurations fast"
    *_, left_out, statuses = run_without(EXTRAS, installed, of_wheel, *commands, trade)
    monkeypatch.chdir(of_source)
    assert ast.literal_eval(statuses) == [*(main(command.split()) for command in commands), 0]
    replays = [json.loads((folder / "replay.json").read_text()) for folder in (of_wheel, of_source)]
    assert replays[0]["updates"] == replays[1]["updates"] != []
    assert left_out.startswith("tradeoff/tradeoff.png: left out, because it needs matplotlib")
    (row,) = json.loads((of_wheel / "tradeoff/tradeoff.json").read_text())["candidates"]
    assert row["verdict"]["sweeps"] == 1


def test_the_help_of_a_command_needs_no_extra(tmp_path: Path) -> None:
    printed = run_without(EXTRAS, ROOT, tmp_path, *(f"{command} --help" for command in COMMANDS))
    usages = [line for line in printed if line.startswith("usage: ")]
    assert [line.split()[2] for line in usages] == list(COMMANDS)
    assert printed[-1] == str([0] * len(COMMANDS))


@pytest.mark.parametrize(
    ("library", "command"),
    [
        ("rosbags", "import bag . --scene bump.yaml -o scan"),
        ("mcap", "import bag . --scene bump.yaml -o scan"),
        ("joblib", "tradeoff a.csv --scan scan --jobs 2"),
        ("distributed", "replay a.csv --scan scan --cluster tcp://a:1"),
        ("matplotlib", "replay a.csv --scan scan --plot b.png"),
        ("jinja2", "replay a.csv --scan scan --report b.html"),
        ("matplotlib", "scan info scan --report b.html"),
        ("rclpy", "demo"),
        ("scipy", "simulate"),
    ],
)
def test_a_missing_library_is_named_in_one_line(library: str, command: str, tmp_path: Path) -> None:
    error, status = run_without([library], ROOT, tmp_path, command)
    assert error.startswith(f"error: {library}: expected it installed, found: ")
    assert "pip install" in error or "source ROS 2" in error
    assert status == "[2]"


def test_all_missing_extras_are_named_at_once(tmp_path: Path) -> None:
    error, _ = run_without(["jinja2", "matplotlib", "mcap"], ROOT, tmp_path, "scan info scan --report b.html")
    assert error.endswith(
        "; `pip install '.[offline]'` installs it and what else is missing: matplotlib, mcap"
    )
