"""The demo command: from CAN frames and palm poses to a converged position, with four nodes and a replay."""

import contextlib
import json
import os
import signal
import sys
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.executors import SingleThreadedExecutor
from rclpy.serialization import deserialize_message
from support.waiting import StarvedError, children, has_ended, wait_until

from tactile_localizer.cli import main
from tactile_localizer.demo.nodes import own_domain
from tactile_localizer.demo.session import Operator, require_sweeps
from tactile_localizer.errors import LiveError
from tactile_localizer.io.bags.reader import Wanted, read_messages
from tactile_localizer.io.scans.folder import ScanFolder
from tactile_localizer.io.scans.writer import ScanWriter
from tactile_localizer.io.whole_file import RESULT
from tactile_localizer.msg import StrainVectors
from tactile_localizer.ros.conversions import from_ns
from tactile_localizer.scene import Axis, Phalanx, Scene
from tactile_localizer.streams.runs import stamp_of


def test_an_interrupt_stops_all_processes(process, tmp_path):
    demo = process(["tactile-localizer", "demo", "--output", tmp_path / "demo", "--speed", "12"])
    demo.wait_for_line("scanning")
    nodes = children(demo.pid)
    assert len(nodes) == 3
    assert demo.stop() == 130
    assert all(map(has_ended, nodes))
    assert "Traceback" not in demo.output


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGHUP], ids=["Ctrl-C", "the terminal closed"])
def test_an_interrupt_lets_what_runs_finish(how):
    if (before := signal.getsignal(how)) is signal.SIG_IGN:
        pytest.skip("the tests were started by nohup, which the demo heeds too")
    finished = []

    def interrupted():
        os.kill(os.getpid(), how)
        finished.append(True)

    with contextlib.closing(Operator(lambda *_: None, lambda: None, print)) as operator:
        with pytest.raises(KeyboardInterrupt):
            operator.until(interrupted, "an interrupt")
        assert finished == [True]
    assert signal.getsignal(how) is before


def test_a_recording_that_is_late_slows_the_hand_down_and_keeps_the_times_of_sending(monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", os.environ["ROS_DOMAIN_ID"])  # restored after the test
    recorded, sent_ns, age_s = [], [], [1.0]

    def record(topic, raw, stamp_ns):
        recorded.append((deserialize_message(raw, StrainVectors).sequence[0] // 2, stamp_ns))

    with own_domain(), contextlib.closing(Operator(record, lambda: None, print, speed=10.0)) as operator:
        hand = rclpy.create_node("tactile_simulator")
        hand.declare_parameter("speed", 10.0)
        strain = hand.create_publisher(StrainVectors, "strain", 10_000)

        def publish():
            if strain.get_subscription_count():
                message = StrainVectors(sequence=[2 * len(sent_ns) + 1])  # every second one is lost
                message.header.stamp = from_ns(time.time_ns() - round(1e9 * age_s[0]))
                sent_ns.append(time.time_ns())
                strain.publish(message)

        hand.create_timer(0.01, publish)
        executor = SingleThreadedExecutor()
        executor.add_node(hand)
        thread = threading.Thread(target=executor.spin)
        thread.start()
        try:
            wait_until(lambda: len(sent_ns) > 10, "messages")
            for age_s[0], speed in ((1.0, 2.5), (3.0, 0.625), (0.0, 10.0)):
                operator.until(lambda: hand.get_parameter("speed").value == speed, f"speed {speed}")  # noqa: B023
        finally:
            executor.shutdown()
            thread.join()
            hand.destroy_node()
        sent_ns.append(time.time_ns())
        assert all(sent_ns[number] <= stamp_ns <= sent_ns[number + 1] for number, stamp_ns in recorded)
        assert operator.lost == len(recorded) - 1


def test_a_step_lasts_for_as_long_as_a_node_reports_progress(monkeypatch):
    passed_s = [0.0]
    clock = SimpleNamespace(monotonic=lambda: passed_s[0], time_ns=time.time_ns)
    monkeypatch.setattr("tactile_localizer.demo.session.time", clock)
    name, steps = "tactile_filter: map", iter(range(1, 6))

    def values(**values):
        return [KeyValue(key=key, value=str(value)) for key, value in values.items()]

    said: list[str] = []
    started = Operator(lambda *_: None, lambda: None, said.append)
    with contextlib.closing(started) as operator:
        node = rclpy.create_node("tactile_filter")
        diagnostics = node.create_publisher(DiagnosticArray, "/diagnostics", 10)

        def advance(**reported):
            """Report, and let most of the time limit pass once that is received; returns whether it is."""
            status = DiagnosticStatus(name=name, message=str(reported), values=values(**reported))
            diagnostics.publish(DiagnosticArray(status=[status]))
            arrived = name in operator.newest and operator.newest[name].values == status.values
            passed_s[0] += 250.0 * arrived
            return arrived

        step = next(steps)

        def loaded():
            nonlocal step
            step = next(steps, None) if advance(fraction=0.2 * step) else step
            return step is None

        try:
            operator.until(loaded, "a map")
            assert passed_s[0] > 1000.0
            assert set(said) == {str({"fraction": 0.2 * step}) for step in range(1, 6)}
            with pytest.raises(LiveError, match="waited 300 s for a map"):
                operator.until(lambda: advance(reason="uniform") and False, "a map")
        finally:
            node.destroy_node()


LINES = 11
"""Lines of the scan: those over the half of the sheet where the first test sweeps are."""
OF_HALF_THE_SHEET = f"""
from tactile_localizer.cli import main
from tactile_localizer.demo import session
session.SCAN_SWEEPS = {LINES}
raise SystemExit(main())
"""
"""The command, with fewer training sweeps."""


@pytest.mark.slow
def test_the_demo_is_the_replay_of_its_bag(process, tmp_path):
    folder = tmp_path / "demo"
    command = [sys.executable, "-c", OF_HALF_THE_SHEET, "demo", "--output", folder]
    demo = process([*command, "--sweeps", "3"])
    status = demo.wait(timeout_s=600.0)
    steps, replayed = demo.output.split("$ tactile-localizer replay ")
    assert f"scanned 7 of {LINES}" in steps
    assert "sweep  3: " in steps
    if "recorded: 3 sweeps, 0 frames lost" not in steps:
        raise StarvedError(demo.output)
    replay = json.loads((folder / "replay.json").read_text())
    verdict = replay["verdict"]
    assert verdict["sweeps"] == verdict["expected"] == 3, demo.output
    assert verdict["right"] >= 2, demo.output
    outcome = "localized" if verdict["success"] else "NOT localized"
    assert f"\n{outcome}: {verdict['right']} of 3 sweeps right" in replayed, demo.output
    assert status == (0 if verdict["success"] else 1), demo.output
    assert [line for line in demo.lines if len(line) > 80 and str(tmp_path) not in line] == []
    assert (folder / "replay.png").stat().st_size > 10_000
    assert len(ScanFolder(folder / "scan").recording().sweeps) == LINES
    logs = {log.stem: log.read_text() for log in (folder / "log").glob("*.log")}
    assert logs.keys() == {"simulator", "driver", "mapping", "filter"}
    assert not any("Traceback" in text for text in logs.values())
    posteriors = Wanted(("tactile_localizer/msg/Posterior",), lambda m, _: m)
    bag = read_messages(folder / "bag", {"/tactile_filter/posterior": posteriors})
    assert {"/strain", "/palm_pose", "/tactile_simulator/ground_truth", "/tactile_mapping/status"} <= set(
        bag.topics
    )
    live = {stamp_of(each.value): each.value for each in bag.received}
    assert max(each.covariance_trace for each in live.values()) > 1e-4, "initially uniform"
    replayed_at = {each["stamp_ns"]: np.array(each["mean"]) for each in replay["updates"]}
    both = live.keys() & replayed_at.keys()  # a recording that is put aside loses some
    assert len(both) > 100
    apart = [live[stamp_ns].mean - replayed_at[stamp_ns] for stamp_ns in both]
    assert np.median(np.linalg.norm(apart, axis=1)) < 0.001, "the live one has also the strain before a sweep"


def test_a_scan_with_an_empty_sweep_is_no_success(tmp_path):
    scene = Scene("line", (Axis("x", 0.0, 1.0),), (Phalanx("index", (0.0,)),))
    with ScanWriter(tmp_path / "scan", scene) as writer:
        for number in (1, 2):
            sweep = writer.begin_sweep()
            sweep.append(np.arange(5), np.full((5, 1), 0.5), np.full((5, 8), float(number)))
            sweep.end()
        require_sweeps(tmp_path / "scan", 2)
        with pytest.raises(LiveError, match="scan: expected 3 sweeps, found 2"):
            require_sweeps(tmp_path / "scan", 3)
        writer.begin_sweep().end()
    with pytest.raises(LiveError, match=r"expected 2 sweeps, found 2; .*sweep 3 has no pairs"):
        require_sweeps(tmp_path / "scan", 2)


def end_at_once(monkeypatch, folder):
    """Stands for the session of the nodes: their files are written, and the demo ends."""

    def record(*_):
        for name in ("scan/sweep_0001.npy", "scan/history.jsonl", "bag/bag.mcap", "log/driver.log"):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text("of the demo")
        raise LiveError("begun")

    monkeypatch.setattr("tactile_localizer.demo.session.record_session", record)


def test_an_earlier_session_is_replaced(monkeypatch, tmp_path, capsys):
    end_at_once(monkeypatch, tmp_path)
    for _ in range(3):
        assert main(["demo", "--output", str(tmp_path)]) == 2
        assert capsys.readouterr().err == "error: begun\n"
        (tmp_path / "scan/calibration.json").write_text(f'{{"kind": "{RESULT}"}}')  # by a replay


@pytest.mark.parametrize(
    "name",
    [
        "scan/sweep_0043.npy",
        "scan/history.jsonl",
        "scan/dropped/sweep_0002.npy",
        "bag/notes.txt",
        "log/session.json",
    ],
)
def test_a_session_with_what_is_not_of_the_demo_stays(monkeypatch, tmp_path, capsys, name):
    end_at_once(monkeypatch, tmp_path)
    assert main(["demo", "--output", str(tmp_path)]) == 2
    capsys.readouterr()
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text("changed by the user")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    assert main(["demo", "--output", str(tmp_path)]) == 2
    assert "expected none, or that of an earlier demo, found " in capsys.readouterr().err
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize("verdict", [0, 1])
@pytest.mark.parametrize("lost", [0, 3])
def test_the_status_is_the_verdict_whatever_was_lost(monkeypatch, tmp_path, capsys, lost, verdict):
    def replay(_):
        (tmp_path / "replay.json").write_text('{"summary": {"sweeps": 18}}')
        return verdict

    monkeypatch.setattr("tactile_localizer.demo.session.record_session", lambda *_: lost)
    monkeypatch.setattr("tactile_localizer.cli.demo.main", replay)
    assert main(["demo", "--output", str(tmp_path)]) == verdict
    assert f"recorded: 18 sweeps, {lost} frames lost\n" in capsys.readouterr().out


def test_a_demo_without_a_sweep_is_refused_before_the_scan(tmp_path, capsys):
    assert main(["demo", "--sweeps", "0", "--output", str(tmp_path / "demo")]) == 2
    assert capsys.readouterr().err == "error: --sweeps: expected at least 1, got 0\n"
    assert not (tmp_path / "demo").exists()
