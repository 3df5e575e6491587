"""Links, commands and names in the pages are valid."""

import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.sweeps import unseen_sweep, write_scan

from tactile_localizer import load_scan, make_localizer
from tactile_localizer.cli import command_parser

ROOT = Path(__file__).parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("examples/**/*.md")])

by_page = pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))


def commands(page: Path, program: str) -> Iterator[list[str]]:
    """The command lines of a program in the code blocks of a page."""
    for line in page.read_text().splitlines():
        found = re.match(rf"(?: {{4}}\s*|```|.*\| )?({program} [^`]*)", line)
        if found and line.startswith(("    ", program)):
            yield shlex.split(found.group(1), comments=True)


@by_page
def test_commands_parse(page: Path) -> None:
    for command in commands(page, "tactile-localizer"):
        try:
            command_parser(command[1:]).parse_args(command[1:])
        except SystemExit:
            pytest.fail(f"expected a command line that is understood, found: {shlex.join(command)}")


@by_page
def test_ros_commands_name_existing_nodes_and_files(page: Path) -> None:
    nodes = "".join(path.read_text() for path in (ROOT / "tactile_localizer/ros").rglob("*.py"))
    parameters = (ROOT / "docs/parameters.md").read_text()
    for _, verb, *words in commands(page, "ros2"):
        line = " ".join(words)
        if verb == "launch":
            own = page.parent / words[0]
            files = [own] if own.is_file() else [ROOT / "launch" / words[1]]
            assert files[0].is_file(), line
            sources = [*files, *(ROOT / "launch").iterdir(), ROOT / "tactile_localizer/ros/launching.py"]
            declared = "".join(path.read_text() for path in sources)
            named = re.findall(r"(\w+):=", line)
            assert [name for name in named if f'"{name}"' not in declared] == [], line
        elif verb == "run":
            assert (ROOT / "scripts" / words[1]).exists(), line
            sections = [one for one in parameters.split("\n## ") if words[1] in one or "_node (" not in one]
            declared = "".join(sections)
            named = re.findall(r"-p (\w+):=", line)
            assert [name for name in named if f"`{name}`" not in declared] == [], line
        elif verb in ("service", "topic"):
            (name,) = re.findall(r"(?<!\S)/(\S+)", line)
            known = {f'"{name}"', f'"/{name}"', f'"~/{name.rpartition("/")[2]}"'}
            assert any(one in nodes for one in known), line


@by_page
def test_make_targets_exist(page: Path) -> None:
    targets = set(re.findall(r"^([a-z-]+):.*##", (ROOT / "Makefile").read_text(), re.MULTILINE))
    for command in commands(page, "make"):
        named = [word for word in command[1:] if "=" not in word]
        assert set(named) <= targets, f"expected targets of {sorted(targets)}, found {named}"


@by_page
def test_named_files_exist(page: Path) -> None:
    folders = "benchmarks|config|docs|examples|launch|msg|requirements|scripts|srv|test"
    for name in re.findall(rf"`((?:{folders})/[\w./-]*)`", page.read_text()):
        assert (ROOT / name).exists(), f"{name}: expected in the source tree, found none"


@by_page
def test_prose_wraps_at_100_columns(page: Path) -> None:
    """Tables, code and figures may be wider."""
    outside_fences = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    lines = [line for line in outside_fences.splitlines() if not line.startswith(("|", "    ", "!["))]
    assert [line for line in lines if len(line) > 100] == []


def test_the_constants_of_streams_are_on_the_page_of_constants() -> None:
    rows = [line for line in (ROOT / "docs/constants.md").read_text().splitlines() if line.startswith("| `")]
    for module in sorted((ROOT / "tactile_localizer/streams").glob("*.py")):
        names = [
            name
            for line in re.findall(r"^([A-Z_, ]+) = [^\n]*\d", module.read_text(), re.MULTILINE)
            for name in line.split(", ")
        ]
        for name in sorted({*names} - {"NANOSECONDS", "LATE", "STRAIN", "POSES", "NO_SWEEP", "_ALWAYS"}):
            own = [row for row in rows if f"`{name}`" in row and f"`{module.stem}`" in row]
            assert own, f"{name} of {module.stem}: expected it in docs/constants.md, found none"


def test_every_picture_is_shown() -> None:
    shown = re.findall(r"!\[[^]]+\]\((?:docs/)?images/([^)]+)\)", "".join(page.read_text() for page in PAGES))
    assert sorted(shown) == sorted(file.name for file in (ROOT / "docs/images").iterdir())


def test_the_readme_links_to_every_page() -> None:
    readme = (ROOT / "README.md").read_text()
    missing = [page.name for page in ROOT.glob("docs/*.md") if f"(docs/{page.name})" not in readme]
    assert missing == []


def test_the_site_has_every_page_and_no_broken_link(tmp_path: Path) -> None:
    pytest.importorskip("mkdocs")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path / "site")]
    built = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=900, check=False)
    assert built.returncode == 0, built.stderr
    assert (tmp_path / "site/docs/concepts/index.html").exists()


def test_the_way_of_a_sample_names_every_module_that_an_update_crosses(tmp_path: Path) -> None:
    write_scan(tmp_path / "bump_scan")
    scan, scene = load_scan(tmp_path / "bump_scan")
    localizer = make_localizer(scan, scene, scan_file=tmp_path / "bump_scan")
    sweep, files = unseen_sweep(), set()
    sys.setprofile(lambda frame, event, argument: files.add(frame.f_code.co_filename))
    for stamp_ns, position, strain in zip(sweep.stamp_ns, sweep.position, sweep.strain, strict=True):
        localizer.update(stamp_ns, position, strain)
    sys.setprofile(None)
    crossed = {Path(file).name for file in files if ROOT / "tactile_localizer" in Path(file).parents}
    way = (ROOT / "CONTRIBUTING.md").read_text().partition("## The way of a sample")[2].partition("\n## ")[0]
    assert len(crossed) > 10
    assert crossed - set(re.findall(r"(\w+\.py)", way)) == set()


@pytest.mark.parametrize(
    "file", [*ROOT.glob("msg/*.msg"), *ROOT.glob("srv/*.srv")], ids=lambda file: file.stem
)
def test_message_fields_are_described(file: Path) -> None:
    assert f"](../{file.relative_to(ROOT)})" in (ROOT / "docs/messages.md").read_text()
    lines = [
        line for line in file.read_text().splitlines() if not line.startswith(("#", "---", "std_msgs/Header"))
    ]
    assert [line for line in lines if line and "#" not in line] == []


def test_topics_and_services_are_described() -> None:
    text = (ROOT / "docs/messages.md").read_text()
    sources = "".join(path.read_text() for path in (ROOT / "tactile_localizer/ros").rglob("*.py"))
    used = set(re.findall(r'"(~/\w+|/diagnostics|strain|palm_pose)"', sources))
    assert len(used) > 15
    assert {name for name in used if f"`{name}`" not in text} == set()


@pytest.mark.ros
def test_the_parameter_page_matches_the_nodes(tmp_path: Path) -> None:
    page = tmp_path / "parameters.md"
    subprocess.run([sys.executable, "docs/make/parameters.py", page], cwd=ROOT, check=True, timeout=900)
    assert page.read_text() == (ROOT / "docs/parameters.md").read_text(), "run `make docs`"


def test_the_first_screen_has_the_two_commands_and_ci_runs_the_one_of_the_tests() -> None:
    first = (ROOT / "README.md").read_text().partition("![")[0]
    said = [line.split("#")[0].strip() for line in first.splitlines() if line.startswith("    make ")]
    assert said == ["make demo", "make test"]
    assert "make test" in (ROOT / ".ci/run").read_text().splitlines()
