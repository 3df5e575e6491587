"""The demo command: from CAN frames and palm poses to a converged position, with four nodes and a replay."""

import contextlib
import os
import signal

import pytest
from support.waiting import children, has_ended

from tactile_localizer.io.bags.reader import Wanted, read_messages
from tactile_localizer.io.scans.folder import ScanFolder

pytestmark = pytest.mark.ros


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGHUP], ids=["Ctrl-C", "the terminal closed"])
def test_an_interrupt_stops_all_processes(process, tmp_path, how):
    if signal.getsignal(how) is signal.SIG_IGN:
        pytest.skip("the tests were started by nohup, which the demo heeds too")
    demo = process(["tactile-localizer", "demo", "--out", tmp_path / "demo", "--speed", "12"])
    demo.wait_for_line("scanning", timeout_s=90.0)
    nodes = children(demo.pid)
    assert len(nodes) == 3
    assert demo.stop(how, timeout_s=30.0) == 130
    assert all(map(has_ended, nodes))
    assert "Traceback" not in demo.output


def test_an_interrupt_lets_what_runs_finish():
    from tactile_localizer.demo.session import Operator

    finished = []

    def interrupted():
        os.kill(os.getpid(), signal.SIGINT)
        finished.append(True)

    before = signal.getsignal(signal.SIGINT)
    with contextlib.closing(Operator(lambda *_: None, check=lambda: None)) as operator:
        with pytest.raises(KeyboardInterrupt):
            operator.until(interrupted, "an interrupt")
        assert finished == [True]
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.slow
def test_the_demo_is_the_replay_of_its_bag(process, tmp_path):
    folder = tmp_path / "demo"
    demo = process(["tactile-localizer", "demo", "--out", folder, "--speed", "12", "--sweeps", "3"])
    status = demo.wait(timeout_s=300.0)
    steps, replayed = demo.output.split("$ tactile-localizer replay ")
    assert "sweep  3: " in steps
    assert "\nlocalized: 3 of 3 sweeps right" in replayed, demo.output
    assert status == 0, demo.output
    assert [line for line in demo.lines if len(line) > 80 and str(tmp_path) not in line] == []
    assert (folder / "replay.png").stat().st_size > 10_000
    assert len(ScanFolder(folder / "scan").recording().sweeps) == 42
    logs = {log.stem: log.read_text() for log in (folder / "log").glob("*.log")}
    assert logs.keys() == {"simulator", "driver", "mapping", "filter"}
    assert not any("Traceback" in text for text in logs.values())
    wanted = {"/filter/posterior": Wanted("tactile_localizer/msg/Posterior", lambda m, _: m.covariance_trace)}
    bag = read_messages(folder / "bag", wanted)
    assert {"/strain", "/palm_pose", "/simulator/ground_truth", "/mapping/status"} <= set(bag.topics)
    assert max(bag.by_topic["/filter/posterior"]) > 1e-4, "initially uniform"


def test_an_output_that_cannot_be_replaced_is_refused(tmp_path, capsys):
    from tactile_localizer.cli import main

    (tmp_path / "bag").touch()
    assert main(["demo", "--out", str(tmp_path)]) == 2
    assert f"{tmp_path}: expected a writable folder, " in capsys.readouterr().err


def test_a_dropped_frame_is_no_success(monkeypatch, tmp_path, capsys):
    from tactile_localizer.cli import demo, main

    monkeypatch.setattr("tactile_localizer.demo.session.record_session", lambda *_: 3)
    monkeypatch.setattr(demo, "main", lambda _: 0)
    assert main(["demo", "--out", str(tmp_path)]) == 2
    assert "driver: expected every frame, 3 were dropped" in capsys.readouterr().err
