"""A short run of the fuzz harness: mutated files of every kind end in a result or in one line."""

import subprocess
import sys
from pathlib import Path

import pytest

FUZZ = Path(__file__).with_name("fuzz.py")


@pytest.mark.slow
def test_no_mutated_file_ends_in_a_traceback_takes_long_or_loads_as_another_map(tmp_path):
    run = subprocess.run(
        [sys.executable, FUZZ, "--rounds", "8", "--seed", "0", "--out", tmp_path],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert run.returncode == 0, run.stdout + run.stderr
    assert "14 kinds, 112 cases" in run.stdout
