"""A replay waits for no library that it does not use."""

from __future__ import annotations

import subprocess
import sys

import pytest


@pytest.fixture(scope="module")
def imported() -> set[str]:
    command = "import sys, tactile_localizer.cli.replay; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", command], check=True, capture_output=True, text=True)
    return set(done.stdout.split())


@pytest.mark.parametrize(
    "name", ["matplotlib", "rosbags", "joblib", "scipy.stats", "scipy.optimize", "scipy.signal"]
)
def test_replay_does_not_import(imported: set[str], name: str) -> None:
    assert name not in imported
