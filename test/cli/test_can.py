"""The command `can`."""

from __future__ import annotations

import threading
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest
from support.load_cells import cycle, protocol

from tactile_localizer.cli import main

HAND = protocol()


def write_log(path: Path, frames: Iterable[can.Message]) -> Path:
    with can.Logger(path) as log:
        for frame in frames:
            log.on_message_received(frame)
    return path


def cycles(numbers: range) -> list[can.Message]:
    return [frame for n in numbers for frame in cycle(HAND, n)]


@pytest.mark.parametrize("ending", ["log", "asc", "log.asc"])
def test_a_good_log_passes_with_its_rates(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], ending: str
) -> None:
    log = write_log(tmp_path / f"hand.{ending}", cycles(range(400)))
    assert main(["can", "check", "--log", str(log), "--phalanges", "index", "middle"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("1600 frames in ")
    (index,) = [line.split() for line in lines if line.split()[:1] == ["index"]]
    assert index[1:6] == ["400", "200.0", "0", "0", "0"]
    assert lines[-1] == "no problems found"


def test_by_default_only_sending_phalanges_are_checked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = write_log(tmp_path / "hand.log", cycles(range(50)))
    assert main(["can", "check", "--log", str(log)]) == 0
    assert "absent: thumb, ring" in capsys.readouterr().out
    assert main(["can", "check", "--log", str(log), "--phalanges", "index", "thumb"]) == 1
    printed = capsys.readouterr().out
    assert "problem: thumb_a (100): no frame" in printed
    assert "not in the DBC: 104, 50 frames" in printed


def test_problems_are_counted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    frames = cycles(range(100))
    del frames[41], frames[80]
    stamp = frames[-1].timestamp
    frames.append(can.Message(arbitration_id=0x102, is_extended_id=False, data=bytes(3), timestamp=stamp))
    frames.append(can.Message(arbitration_id=0x80, is_error_frame=True, timestamp=stamp))
    frames += HAND.encode(0, np.array([0, 0, 0, 0, 0, 9.0, 0, 0]), 100, stamp_s=stamp)
    frames += HAND.encode(1, np.zeros(8), 100, status=1, stamp_s=stamp)
    log = write_log(tmp_path / "hand.log", frames)
    assert main(["can", "check", "--log", str(log)]) == 1
    printed = capsys.readouterr().out
    for line in (
        "index_a: expected 8 bytes, found 3, 8",
        "index: frames lost: 2",
        "index: samples saturated, gauges 6: 1",
        "middle: samples with a fault: 1",
        "error frames: 1",
    ):
        assert f"problem: {line}" in printed


def test_a_dump_has_a_line_per_frame(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stranger = can.Message(arbitration_id=0x7FF, is_extended_id=False, data=b"hi", timestamp=1.7e9)
    log = write_log(tmp_path / "hand.log", [stranger, *cycle(HAND, 3)])
    assert main(["can", "dump", "--log", str(log)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 5
    assert lines[0].split() == ["1700000000.000000", "7FF", "unknown", "id", "68", "69"]
    assert lines[1].split()[1:5] == ["102", "index_a", "3", "-0.99400"]


CANDUMP = "(1700000000.{:06}) can0 {}\n"
"""A line as ``candump -l`` writes it; the first place is for the microseconds."""


def candump(path: Path, lines: Iterable[str]) -> Path:
    path.write_text("".join(CANDUMP.format(100 * i, frame) for i, frame in enumerate(lines)))
    return path


def frames_of(numbers: range) -> list[str]:
    return [f"{frame.arbitration_id:03X}#{frame.data.hex().upper()}" for frame in cycles(numbers)]


def test_error_and_remote_frames_of_a_candump_log_are_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    others = ["20000004#0008000000000000", "20000080#0000000000000000", "102#R8", "102#R"]
    log = candump(tmp_path / "hand.log", frames_of(range(20)) + others)
    assert main(["can", "check", "--log", str(log)]) == 1
    printed = capsys.readouterr().out
    assert "problem: error frames: 2" in printed
    assert "problem: remote frames: 2" in printed
    assert "not in the DBC" not in printed


def test_a_channel_of_a_log_is_selected(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = candump(tmp_path / "hand.log", frames_of(range(20)))
    lines = log.read_text().splitlines(keepends=True)
    log.write_text("".join(line + line.replace("can0", "can1") for line in lines))
    assert main(["can", "check", "--log", str(log)]) == 2
    assert "expected frames of one channel, found can0 and can1" in capsys.readouterr().err
    assert main(["can", "check", "--log", str(log), "--channel", "can1"]) == 0


def test_a_log_is_read_for_the_given_duration(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = write_log(tmp_path / "hand.log", cycles(range(400)))
    assert main(["can", "check", "--log", str(log), "--seconds", "0.9975"]) == 0
    assert capsys.readouterr().out.startswith("800 frames in 0.99 s")


@pytest.mark.parametrize(
    "line", ["hello", "# comment", "  can0  102   [8]  60 30 18 1C 06 8B C1 00", "(1.0) can0 102#0g", "(1.0"]
)
def test_an_invalid_candump_line_is_located(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], line: str
) -> None:
    log = candump(tmp_path / "hand.log", frames_of(range(20)))
    log.write_text(log.read_text() + line + "\n")
    for action in ("check", "dump"):
        assert main(["can", action, "--log", str(log)]) == 2
        printed = capsys.readouterr().err
        assert printed.startswith(f"error: {log} line 81: ")
        assert printed.endswith(f"found {line.strip()!r}\n")
        assert printed.count("\n") == 1


def test_an_impossible_stamp_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / "hand.log"
    log.write_text(f"({10**300}.000000) can0 102#0000000000000000\n")
    assert main(["can", "check", "--log", str(log)]) == 2
    assert "expected stamps of at most 9e+09 s, found 1e+300" in capsys.readouterr().err


def test_a_bus_is_read_for_the_given_duration(
    simulated_can: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    end = threading.Event()

    def send() -> None:
        with can.Bus(**simulated_can, hop_limit=0) as bus:
            number = 0
            while not end.wait(0.005):
                for frame in cycle(HAND, number):
                    bus.send(frame)
                number += 1

    hand = threading.Thread(target=send)
    hand.start()
    try:
        options = ["--interface", "udp_multicast", "--channel", simulated_can["channel"]]
        options += ["--option", f"port={simulated_can['port']}", "--seconds", "0.5"]
        status = main(["can", "check", *options])
    finally:
        end.set()
        hand.join()
    printed = capsys.readouterr().out
    assert "index_a" in printed
    assert status == 0, printed


def test_a_silent_bus_is_reported_with_advice(
    simulated_can: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--interface", "udp_multicast", "--channel", simulated_can["channel"], "--seconds", "0.1"]
    assert main(["can", "check", *options, "--option", f"port={simulated_can['port']}"]) == 1
    assert "nothing received: is the interface up" in capsys.readouterr().out


def test_driver_parameters_are_used(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = write_log(tmp_path / "hand.log", cycles(range(20)))
    config = tmp_path / "driver.yaml"
    config.write_text(
        "driver:\n  ros__parameters:\n    phalanges: [finger]\n"
        "    messages.finger: [index_a, index_b]\n    dbc: loadcells.dbc\n"
    )
    assert main(["can", "check", "--log", str(log), "--config", str(config)]) == 0
    assert "finger" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("parameter", "reason"),
    [
        ("phalanges: index", "phalanges: expected a list of strings, got 'index'"),
        ("messages.index: 7", "messages.index: expected a list of strings, got 7"),
        ("dbc: 5", "dbc: expected a string, got 5"),
        ("counter_signal: [a]", r"counter_signal: expected a string, got ['a']"),
        ("cycle_timeout_s: soon", "cycle_timeout_s: expected a number from 0.0005 to 1, got 'soon'"),
        ("cycle_timeout_s: 0", "cycle_timeout_s: expected a number from 0.0005 to 1, got 0"),
        ("cycle_timeout_s: 1e300", "cycle_timeout_s: expected a number from 0.0005 to 1, got 1e+300"),
    ],
)
def test_a_parameter_of_another_type_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], parameter: str, reason: str
) -> None:
    config = tmp_path / "driver.yaml"
    config.write_text(f"driver:\n  ros__parameters:\n    {parameter}\n    tare_duration_s: 1.0\n")
    assert main(["can", "check", "--log", "/nowhere.log", "--config", str(config)]) == 2
    assert f"{config}: {reason}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--seconds", "0"], "--seconds: expected more than 0, got 0"),
        (["--seconds", "nan"], "--seconds: expected more than 0, got nan"),
        (["--log", "/nowhere.log"], "/nowhere.log: expected a CAN log, No such file"),
        (["--log", __file__], "expected a CAN log"),
        (["--channel", "can7"], "CAN bus socketcan can7: expected an interface that opens"),
        (["--dbc", "/nowhere.dbc"], "/nowhere.dbc: expected a DBC file"),
        (["--config", "/nowhere.yaml"], "/nowhere.yaml: expected driver parameters"),
        (["--config", str(Path(__file__).parents[2] / "LICENSE")], "LICENSE: expected YAML, "),
        (["--option", "port"], "bus option 'port': expected name=value"),
    ],
)
def test_bad_input_is_one_line(arguments: list[str], reason: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["can", "check", *arguments]) == 2
    printed = capsys.readouterr().err
    assert reason in printed
    assert printed.count("\n") == 1
