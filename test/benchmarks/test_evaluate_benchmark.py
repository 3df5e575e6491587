"""The benchmark that compares methods."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import evaluate
import pytest
from support.waiting import wait_until

BENCHMARK = Path(__file__).parents[2] / "benchmarks" / "evaluate.py"
OWN = "test.csv --scan scan.db --scene scene.yaml --seeds 2 --methods fast own.yaml"


@pytest.fixture(autouse=True)
def own_method(bump_folder: Path) -> None:
    Path("own.yaml").write_text("filter: particle\nparticles: 40\n")


def without_times(document: dict) -> dict:
    tasks = {name: [{**task, "timing": None} for task in of] for name, of in document["tasks"].items()}
    return {**document, "tasks": tasks, "tables": None}


def test_recordings_are_evaluated_on_a_scan(bump_folder: Path, capsys) -> None:
    assert evaluate.main([*OWN.split(), "-o", "out"]) == 0
    printed = capsys.readouterr().out
    assert "bump, mm" in printed
    assert "out/report.html" in printed
    document = json.loads(Path("out/evaluate.json").read_text())
    assert list(document["methods"]) == ["fast", "own"]
    assert len(document["tasks"]["own"]) == 2
    assert "test.csv --scan scan.db" in Path("out/report.html").read_text()
    assert Path("out/methods.png").stat().st_size > 5000


def test_the_number_of_workers_makes_no_difference(bump_folder: Path) -> None:
    documents = []
    for jobs in ("1", "2"):
        few = ["--seeds", "1", "--starts", "1", "--travel", "0.01"]
        assert evaluate.main([*OWN.split(), *few, "-o", f"jobs{jobs}", "--jobs", jobs]) == 0
        documents.append(without_times(json.loads(Path(f"jobs{jobs}/evaluate.json").read_text())))
    assert documents[0] == documents[1]


def test_an_interrupted_run_resumes(bump_folder: Path) -> None:
    command = [sys.executable, BENCHMARK]
    # More tasks than are done before the signal arrives.
    arguments = [*OWN.split(), "--seeds", "4", "-o", "again"]

    def results() -> list[Path]:
        return list(Path("again/tasks").glob("[!.]*.json"))  # what is being written begins with a dot

    running = subprocess.Popen([*command, *arguments, "--jobs", "2"], stderr=subprocess.PIPE, text=True)
    try:
        wait_until(lambda: len(results()) > 2 or running.poll() is not None, "some results", 120)
        running.terminate()
        _, printed = running.communicate(timeout=60)  # also waits for workers, who have the same stderr
    finally:
        running.terminate()  # ends the workers too, which SIGKILL would leave
        running.wait(60)
    assert running.returncode == 130, printed
    assert "Warning" not in printed
    before = {file: file.stat().st_mtime_ns for file in results()}
    assert 2 < len(before) < 9
    assert evaluate.main(arguments) == 0
    assert len(results()) == 9  # one calibration, four seeds of two methods
    assert all(file.stat().st_mtime_ns == written for file, written in before.items())


def test_random_starts_are_evaluated_along_their_travel(bump_folder: Path, capsys) -> None:
    arguments = [*OWN.split(), "--seeds", "1", "--starts", "3", "--travel", "0.02", "-o", "starts"]
    assert evaluate.main(arguments) == 0
    assert "bump, mm" in capsys.readouterr().out
    document = json.loads(Path("starts/evaluate.json").read_text())
    (task,) = document["tasks"]["own"]
    assert len(task["sweeps"]) == 3
    assert all(sweep["error_m"] > 0.0 for sweep in task["sweeps"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("--sweeps 0", "--sweeps: expected at least 1, got 0"),
        ("--seeds 0", "--seeds: expected at least 1, got 0"),
        ("--blanks -1", "--blanks: expected at least 0, got -1"),
        ("--jobs 0", "jobs: expected at least 1"),
        ("--methods defualt", "--methods defualt: expected a YAML file or one of default, "),
        ("test.csv", "recordings: expected --scan with them"),
        ("test.csv --scan scan.db --travel 0.1", "--travel: expected --starts with it"),
        ("--scan scan.db", "scan.db: expected recordings to localize on it"),
    ],
)
def test_unusable_requests_are_refused_in_one_line(
    bump_folder: Path, capsys, arguments: str, message: str
) -> None:
    assert evaluate.main(arguments.split()) == 2
    printed = capsys.readouterr()
    assert message in printed.err
    assert printed.err.count("\n") == 1
