"""The launch files, read by the real launch system."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import pytest

LAUNCH_FILES = sorted((Path(__file__).parents[2] / "launch").glob("*.launch.py"))

# Not "launch": the source tree's own launch/ would pass for it.
pytest.importorskip("launch_ros", reason="launch_ros is not installed: only a ROS 2 distribution has it")


def description_of(path: Path) -> Any:
    spec = importlib.util.spec_from_file_location(path.name.removesuffix(".launch.py"), path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.generate_launch_description()


@pytest.mark.parametrize("path", LAUNCH_FILES, ids=lambda path: path.name)
def test_every_argument_is_described(path: Path) -> None:
    arguments = description_of(path).get_launch_arguments()
    assert [argument.name for argument in arguments if argument.description == "no description given"] == []
    assert {"namespace", "strain_topic", "pose_topic", "use_sim_time"} <= {one.name for one in arguments}


def test_the_lifecycle_manager_example_activates_the_nodes() -> None:
    path = Path(__file__).parents[2] / "examples/lifecycle_manager/managed_bringup.launch.py"
    assert description_of(path).get_launch_arguments()[0].name == "scan_file"
    assert '"node_names": ["driver", "filter"]' in path.read_text()
