"""A test that CI tries again leaves a record of why."""

import os
import subprocess
import sys
from pathlib import Path

LIBRARY = Path(__file__).parent / "lib"
UNSTEADY = """
import pathlib

def test_unsteady():
    seen = pathlib.Path(__file__).with_name("seen")
    print("the node was late")
    tried, _ = seen.exists(), seen.touch()
    assert tried, "waited 15 s for the node"
"""


def test_the_reason_and_the_output_of_the_first_failure_are_printed(tmp_path):
    (tmp_path / "test_unsteady.py").write_text(UNSTEADY)
    (tmp_path / "pytest.ini").touch()
    command = [sys.executable, "-m", "pytest", "-p", "support.reruns", "--reruns", "1"]
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(LIBRARY), os.environ.get("PYTHONPATH", "")]),
    }
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    assert "1 passed, 1 rerun" in done.stdout
    assert "AssertionError: waited 15 s for the node" in done.stdout
    assert "the node was late" in done.stdout
