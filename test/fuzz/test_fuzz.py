"""A short run of the fuzz harness."""

import subprocess
import sys
from pathlib import Path

import pytest

FUZZ = Path(__file__).with_name("fuzz.py")


@pytest.mark.slow
def test_mutated_files_give_a_result_or_one_error_line(tmp_path):
    run = subprocess.run(
        [sys.executable, FUZZ, "--rounds", "8", "--seed", "0", "--out", tmp_path],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert run.returncode == 0, run.stdout + run.stderr
    assert "11 kinds, 88 cases" in run.stdout
