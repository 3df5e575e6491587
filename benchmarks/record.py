"""Rows of measurements, merged by name into ``out/bench.json``.

The file holds ``machine``, ``versions`` and ``rows``. A row has ``name``, ``value`` and ``unit``, if required
a ``limit`` (with ``<=`` or ``>=``) and whether it is ``met``, and further values.
"""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

from evaluation.report import processor
from rich.console import Console
from rich.table import Table

from tactile_localizer.io.whole_file import whole_file

OUT = Path("out/bench.json")
"""File in the working directory."""

_PACKAGES = ("numpy", "scipy", "python-can", "cantools", "rclpy")


def row(name: str, value: float, unit: str, limit: str | None = None, **more: Any) -> dict[str, Any]:
    """One measurement; ``limit`` is the required value, such as ``<= 0.5``."""
    value = float(value)
    made: dict[str, Any] = {"name": name, "value": value, "unit": unit}
    if limit is not None:
        relation, bound = limit.split()
        made["limit"] = limit
        made["met"] = value <= float(bound) if relation == "<=" else value >= float(bound)
    return made | more


def record(rows: Sequence[dict[str, Any]], path: Path = OUT) -> None:
    """Merge ``rows`` by name into the file, and print them."""
    try:
        kept = {one["name"]: one for one in json.loads(path.read_text())["rows"]}
    except FileNotFoundError:
        kept = {}
    kept |= {one["name"]: one for one in rows}
    text = json.dumps({"machine": _machine(), "versions": _versions(), "rows": list(kept.values())}, indent=2)
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as unfinished:
        unfinished.write_text(text + "\n")
    _print(rows)


def _machine() -> dict[str, Any]:
    return {
        "cpu": processor(),
        "cores": os.cpu_count(),
        "load": round(
            os.getloadavg()[0], 1
        ),  # average number of processes that were ready to run in the last minute
        "system": platform.system(),
        "kernel": platform.release(),
    }


def _versions() -> dict[str, str]:
    versions = {"python": platform.python_version()}
    for package in _PACKAGES:
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            versions[package] = "not installed"
    return versions


_DETAILS = {"p99_us": "p99", "peak_mb": "MB", "ratio_to_floor": "floors", "tv_to_exact": "TV to exact"}


def _print(rows: Sequence[dict[str, Any]]) -> None:
    details = {key: head for key, head in _DETAILS.items() if any(key in one for one in rows)}
    table = Table()
    for head in ("measurement", "value", *details.values(), "limit", "met"):
        table.add_column(head, no_wrap=True)
    for one in rows:
        met = {True: "yes", False: "NO"}.get(one.get("met"), "")
        more = [f"{one[key]:.3g}" if one.get(key) is not None else "" for key in details]
        table.add_row(one["name"], f"{one['value']:.4g} {one['unit']}", *more, one.get("limit", ""), met)
    console = Console()
    console.width = max(console.width, 140)  # also if the output is a file
    console.print(table)
