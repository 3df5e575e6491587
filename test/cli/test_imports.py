"""A replay imports no library that it does not use."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from support.sweeps import write_scan

from tactile_localizer.cli import main


@pytest.fixture(scope="module")
def imported(tmp_path_factory: pytest.TempPathFactory) -> set[str]:
    """Modules imported by a replay on a scan with a stored calibration."""
    folder: Path = tmp_path_factory.mktemp("replay")
    write_scan(folder / "bump_scan")
    assert main(["simulate", "bump", "-o", str(folder), "--train", "1", "--test", "1"]) == 0
    lines = (folder / "test.csv").read_text().splitlines()
    (folder / "two.csv").write_text("\n".join(lines[:3]))
    arguments = ["replay", str(folder / "two.csv"), "--scan", str(folder / "bump_scan")]
    command = f"import sys; from tactile_localizer.cli import main; main({arguments}); print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", command], check=True, capture_output=True, text=True)
    return set(done.stdout.splitlines()[-1].split())


@pytest.mark.parametrize("name", ["matplotlib", "rosbags"])
def test_replay_does_not_import(imported: set[str], name: str) -> None:
    assert "tactile_localizer.offline.replay" in imported
    assert name not in imported
