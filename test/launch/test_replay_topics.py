"""Topics that a replay leaves out, in the grammars of rosbag2's storage plugins."""

import ast
import shutil
import subprocess
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
MATCHER = """
#include <iostream>
#include <regex>

int main(int, char ** argv) {
    const bool posix = argv[1] == std::string("sqlite3");
    const std::regex all(argv[2], posix ? std::regex::extended | std::regex::nosubs : std::regex::ECMAScript);
    for (std::string topic; std::getline(std::cin, topic);) {
        if (std::regex_match(topic, all)) std::cout << topic << std::endl;
    }
}
"""
"""Matches as rosbag2 does: its plugin for sqlite3 in POSIX extended, that for MCAP in ECMAScript."""


@pytest.fixture(scope="module")
def matcher(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The compiled program."""
    compiler, folder = shutil.which("c++"), tmp_path_factory.mktemp("matcher")
    if compiler is None:
        pytest.skip("a C++ compiler is not installed")
    (folder / "matcher.cpp").write_text(MATCHER)
    subprocess.run([compiler, folder / "matcher.cpp", "-o", folder / "matcher"], check=True, timeout=900)
    return folder / "matcher"


def excluded_topics() -> str:
    """The expression in the launch file, which only a machine with launch can import."""
    tree = ast.parse((ROOT / "launch/replay.launch.py").read_text())
    values = {
        statement.targets[0].id: statement.value
        for statement in tree.body
        if isinstance(statement, ast.Assign) and isinstance(statement.targets[0], ast.Name)
    }
    return str(ast.literal_eval(values["WITHOUT"]))


def topics_of_the_filter(way: str) -> set[str]:
    """Topics of the filter in the security policy, which a test compares with the running node."""
    policy = ElementTree.parse(ROOT / "config/security/policy.xml")
    groups = policy.findall(f".//profile[@node='tactile_filter']/topics[@{way}='ALLOW']/topic")
    names = {str(element.text).replace("~", "tactile_filter") for element in groups}
    own = {name for name in names if not name.startswith("/")}
    return {f"{namespace}/{name}" for namespace in ("", "/left") for name in own}


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_a_replay_leaves_out_what_the_filter_publishes(matcher: Path, storage: str) -> None:
    published = topics_of_the_filter("publish") | {"/diagnostics", "/clock"}
    others = {"/tf", "/tf_static", "/arm/palm_pose", "/tactile_mapping/map", "/clock2", "/posterior"}
    command = [matcher, storage, excluded_topics()]
    lines = "\n".join(published | topics_of_the_filter("subscribe") | others)
    found = subprocess.run(command, input=lines, capture_output=True, text=True, check=True, timeout=900)
    assert set(found.stdout.split()) == published
