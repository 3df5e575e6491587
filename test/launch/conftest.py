"""Fixtures of the tests of launch files."""

import shutil
from pathlib import Path
from typing import Any

import pytest
from support.launching import Launch
from support.processes import Process


@pytest.fixture
def launch(process: Any, tmp_path: Path) -> Launch:
    """See :data:`support.launching.Launch`."""
    command = shutil.which("ros2")
    assert command is not None

    def start(name: str | Path, *options: str, **arguments: Any) -> Process:
        given = [f"{argument}:={value}" for argument, value in arguments.items()]
        file = [name] if isinstance(name, Path) else ["tactile_localizer", f"{name}.launch.py"]
        line = [command, "launch", *file, *options, *given]
        environment = {"ROS_HOME": str(tmp_path), "ROS_LOG_DIR": str(tmp_path / "log")}
        launched: Process = process(line, environment)
        return launched

    return start
