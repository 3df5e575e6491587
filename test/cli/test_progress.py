"""Progress on terminals and in pipes."""

from __future__ import annotations

import os
import pty
import subprocess
import sys

import pytest

from tactile_localizer.cli import progress

PROGRAM = """
from tactile_localizer.cli.progress import progress_bars
with progress_bars() as show:
    for fraction in (0.0, 0.5, 1.0):
        show("sorting", fraction)
print("done")
"""


def test_nothing_is_printed_into_a_pipe(capsys: pytest.CaptureFixture) -> None:
    with progress.progress_bars() as show:
        show("sorting", 0.5)
        show("sorting", 1.0)
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err == ""


def test_a_terminal_shows_a_transient_bar() -> None:
    control, terminal = pty.openpty()
    try:
        environment = os.environ | {"TERM": "xterm", "PYTHONPATH": os.pathsep.join(sys.path)}
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
    assert "sorting" in shown
    assert "━" in shown
