"""Progress on terminals and elsewhere."""

import sys

import pytest

from tactile_localizer.cli import progress


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


def test_a_terminal_shows_a_line_and_erases_it(monkeypatch, capsys: pytest.CaptureFixture) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with progress.progress_line() as show:
        for fraction in (0.0, 0.5, 1.0):
            show("sorting", fraction)
    erased = "\r\x1b[K"
    shown = "".join(f"{erased}sorting: {fraction}%" for fraction in (0, 50, 100)) + erased
    assert capsys.readouterr() == ("", shown)
