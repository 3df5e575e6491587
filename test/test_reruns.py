"""Only a test that starved is repeated, and the report says so."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LIBRARY = ROOT / "test/lib"
UNSTEADY = """
import pathlib
from support.waiting import StarvedError

def test_unsteady():
    seen = pathlib.Path(__file__).with_name("seen")
    print("the node was late")
    is_second, _ = seen.exists(), seen.touch()
    if not is_second:
        raise {error}("waited 15 s for the node")
"""


def run(folder: Path, error: str) -> subprocess.CompletedProcess:
    """Run, with the options of the Makefile, a test that fails once."""
    (folder / "test_unsteady.py").write_text(UNSTEADY.format(error=error))
    (folder / "pytest.ini").touch()
    options = re.search(r"--reruns .*?--only-rerun \w+", (ROOT / "Makefile").read_text()).group().split()
    command = [sys.executable, "-m", "pytest", "-p", "support.reruns", *options]
    path = os.pathsep.join([str(LIBRARY), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": path}
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def test_a_starved_test_is_repeated_and_reported(tmp_path: Path) -> None:
    done = run(tmp_path, "StarvedError")
    assert done.returncode == 0, done.stdout
    assert "1 passed, 1 rerun" in done.stdout
    assert "starved and repeated" in done.stdout
    assert "waited 15 s for the node" in done.stdout
    assert "the node was late" in done.stdout


@pytest.mark.parametrize("error", ["AssertionError", "TimeoutError"])
def test_no_other_failure_is_repeated(tmp_path: Path, error: str) -> None:
    done = run(tmp_path, error)
    assert done.returncode == 1
    assert " rerun" not in done.stdout.splitlines()[-1]


def test_a_missed_deadline_without_load_is_no_starvation(monkeypatch: pytest.MonkeyPatch) -> None:
    from support import waiting

    monkeypatch.setattr(waiting, "cpu_waits_s", lambda: {1: 0.0})
    with pytest.raises(AssertionError) as failure:
        waiting.wait_until(lambda: False, "nothing", 0.05)
    assert failure.type is AssertionError


def test_a_missed_deadline_of_a_waiting_process_is_starvation(monkeypatch: pytest.MonkeyPatch) -> None:
    from support import waiting

    waits = iter([{1: 3.0}, {1: 3.0, 2: 0.04}])
    monkeypatch.setattr(waiting, "cpu_waits_s", lambda: next(waits))
    with pytest.raises(waiting.StarvedError, match="nothing"):
        waiting.wait_until(lambda: False, "nothing", 0.05)
