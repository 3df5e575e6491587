"""The examples work as their pages describe, in copies outside the source tree."""

import json
import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import can
import cantools
import numpy as np
import pytest
from support.waiting import wait_until

EXAMPLES = Path(__file__).parents[1] / "examples"
VOLTS = {"LC1_STRAIN": 0.1 * np.arange(1, 9), "LC2_STRAIN": -0.002 * np.arange(1, 9)}


@pytest.fixture
def copied(tmp_path: Path) -> Callable[[str], Path]:
    return lambda name: Path(shutil.copytree(EXAMPLES / name, tmp_path / name))


def commands(page: Path, but: tuple[str, ...]) -> str:
    """The command lines of a page, except those that contain one of the words in ``but``."""
    lines = [line.strip() for line in page.read_text().splitlines() if line.startswith("    ")]
    return "\n".join(line for line in lines if not any(word in line for word in but))


def follow(page: Path, more: str = "", but: tuple[str, ...] = ()) -> str:
    """Run the commands of a page, the last one with ``more`` arguments; returns their output."""
    done = subprocess.run(
        ["bash", "-euc", commands(page, but) + more],
        cwd=page.parent,
        env={"PYTHONPATH": "", **os.environ},
        capture_output=True,
        text=True,
        timeout=900,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def summary(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text())["summary"]


def frames() -> list[can.Message]:
    """A sample of the load cells of ``own_dbc``, encoded by cantools instead of the package."""
    database = cantools.database.load_file(EXAMPLES / "own_dbc/hand.dbc")
    return [
        can.Message(
            arbitration_id=database.get_message_by_name(name).frame_id,
            is_extended_id=False,
            is_fd=True,
            data=database.encode_message(name, {f"sg{i + 1}": 1e6 * value for i, value in enumerate(volts)}),
        )
        for name, volts in VOLTS.items()
    ]


@pytest.mark.ros
def test_the_driver_publishes_own_load_cells(
    copied: Callable[[str], Path],
    node_process: Any,
    probe: Any,
    bus: dict[str, Any],
    simulated_can: dict[str, Any],
) -> None:
    from tactile_localizer.msg import StrainVectors

    folder = copied("own_dbc")
    received = probe.listen(StrainVectors, "strain", probe.best_effort)
    own = {**bus, "period_s": 0.4, "dbc": folder / "hand.dbc", "tare_file": folder / "tare.yaml"}
    node_process("driver_node", own, parameter_files=[folder / "driver.yaml"])
    with can.Bus(**simulated_can, fd=True, hop_limit=0) as hand:

        def send_and_receive() -> list[Any]:
            for frame in frames():
                hand.send(frame)
            probe.executor.spin_once(timeout_sec=0.05)
            return [message for message in received if not any(message.status)]

        found = wait_until(send_and_receive, "a strain vector")[-1]
    assert found.phalanges == ["index", "middle"]
    np.testing.assert_allclose(found.strain, np.concatenate(list(VOLTS.values())), atol=1e-6)


def test_an_own_scene_is_scanned_and_localized(copied: Callable[[str], Path]) -> None:
    page = copied("own_scene") / "README.md"
    follow(page, more=" --json out.json", but=("scan plot",))
    found = summary(page.parent / "out.json")
    assert np.degrees(found["error_rad"]["median"]) < 1.0
    assert found["converged_sweeps"] == found["sweeps"] == 6
    assert found["error_converged_m"]["median"] < 0.002


def test_an_own_measurement_model_localizes(copied: Callable[[str], Path]) -> None:
    page = copied("own_model") / "README.md"
    # So simple a model does not converge on every sweep, which a replay reports by its status.
    printed = follow(page, more=" --json out.json || test $? = 1")
    assert "nearest_student:NearestStudent" in printed
    found = summary(page.parent / "out.json")
    assert found["error_converged_m"]["median"] < 0.004
