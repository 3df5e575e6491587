"""Progress on terminals and elsewhere."""

from __future__ import annotations

import os
import pty
import subprocess
import sys

import pytest

from tactile_localizer.cli import progress

PROGRAM = """
from tactile_localizer.cli.progress import progress_line
with progress_line() as show:
    for fraction in (0.0, 0.5, 1.0):
        show("sorting", fraction)
print("done")
"""


def test_elsewhere_a_line_is_printed_now_and_then(monkeypatch, capsys: pytest.CaptureFixture) -> None:
    now_s = 0.0
    monkeypatch.setattr(progress.time, "monotonic", lambda: now_s)
    with progress.progress_line() as show:
        for second in range(25):
            now_s = float(second)
            show("sorting", second / 25)
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err == "sorting: 40%\nsorting: 80%\n"


def test_a_terminal_shows_a_line_and_erases_it() -> None:
    control, terminal = pty.openpty()
    try:
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM],
            stdout=subprocess.PIPE,
            stderr=terminal,
            env=environment,
            check=True,
        )
        shown = os.read(control, 65536).decode()
    finally:
        os.close(control)
        os.close(terminal)
    assert done.stdout == b"done\n"
    assert shown.endswith("sorting: 100%\r\x1b[K")
    assert shown.count("\r\x1b[K") == 4
    assert "\n" not in shown
