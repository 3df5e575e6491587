"""Reports each test that was repeated because it starved; pytest-rerunfailures only counts them."""

from __future__ import annotations

from typing import Any


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Print the failure and the output of each attempt that starved."""
    for report in terminalreporter.stats.get("rerun", ()):
        terminalreporter.section(f"starved and repeated: {report.nodeid}", sep="-")
        terminalreporter.write_line(report.longreprtext)
        for name, content in report.sections:
            terminalreporter.write_line(f"--- {name}\n{content}")
