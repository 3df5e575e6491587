"""HTML report in a single file with figures and tables; figures as PNG files."""

from __future__ import annotations

import base64
import io
import os
import platform
from collections.abc import Mapping, Sequence
from html import escape
from importlib.metadata import version
from pathlib import Path

import matplotlib
from matplotlib.figure import Figure

from tactile_localizer import __version__
from tactile_localizer.errors import ScanError
from tactile_localizer.io.whole_file import whole_file
from tactile_localizer.offline.table import Table

_LIBRARIES = ("numpy", "scipy", "matplotlib", "joblib")

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #222; background: #fff; max-width: 70rem; margin: 0 auto;
       padding: 1rem; }
h1 { font-size: 1.6rem; } h2 { font-size: 1.2rem; margin: 2rem 0 .5rem; }
figure { margin: 1rem 0; break-inside: avoid; } img { max-width: 100%; height: auto; }
.note, figcaption { color: #555; font-size: .85rem; }
.wide { overflow-x: auto; } table { border-collapse: collapse; font-size: .85rem; }
th, td { padding: .25rem .6rem; text-align: right; border-bottom: 1px solid #ddd; white-space: nowrap; }
th:first-child, td:first-child { text-align: left; }
.words td { white-space: normal; text-align: left; vertical-align: top; }
@media print {
  body { max-width: none; padding: 0; font-size: 10pt; } .wide { overflow: visible; }
  table { font-size: 7pt; } th, td { padding: .1rem .25rem; white-space: normal; overflow-wrap: break-word; }
}
"""

_PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title><style>{style}</style></head>
<body>
<h1>{title}</h1>
<p>{summary}</p>
{parts}
</body></html>
"""


def write_report(
    path: Path,
    title: str,
    summary: str,
    figures: Mapping[str, Figure],
    tables: Sequence[Table],
    command: str,
) -> None:
    """Write a page with figures by name, tables, the command, and the machine on which it ran.

    Raises
    ------
    ScanError
        The file cannot be written.
    """
    made_with = Table("Made with", ("", ""), list({"command": command, **machine()}.items()))
    parts = [*(_figure(*named) for named in figures.items()), *map(_section, [*tables, made_with])]
    page = _PAGE.format(title=escape(title), summary=escape(summary), style=_STYLE, parts="\n".join(parts))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as unfinished:
            unfinished.write_text(page, encoding="utf-8")
    except OSError as error:
        raise ScanError(f"{path}: expected to write a report, {error.strerror}") from None


def save_figures(figures: Mapping[str, Figure], folder: Path) -> None:
    """Write figures as PNG files named by their keys.

    Raises
    ------
    ScanError
        A file cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, figure in figures.items():
            figure.savefig(folder / f"{name}.png", dpi=150)
    except OSError as error:
        raise ScanError(f"{folder}: expected to write figures, {error.strerror}") from None


def machine() -> dict[str, str]:
    """Processor, cores, system and software versions of this machine, by name."""
    return {
        "processor": processor(),
        "cores": str(len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()),
        "system": f"{platform.system()} {platform.release()}, {platform.machine()}",
        "Python": platform.python_version(),
        "tactile_localizer": __version__,
        **{name: version(name) for name in _LIBRARIES},
    }


def processor() -> str:
    """Name of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or "unknown"


def _section(table: Table) -> str:
    head = "".join(f"<th>{escape(column)}</th>" for column in table.columns)
    rows = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in table.rows)
    kind = ' class="words"' if any(len(cell) > 60 for row in table.rows for cell in row) else ""
    return (
        f'<h2>{escape(table.title)}</h2><p class="note">{escape(table.note)}</p>'
        f'<div class="wide"><table{kind}><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>'
    )


def _figure(name: str, figure: Figure) -> str:
    """Figure as a data URL, the same bytes for the same figure."""
    buffer = io.BytesIO()
    with matplotlib.rc_context({"svg.hashsalt": "tactile_localizer"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    data = base64.b64encode(buffer.getvalue()).decode()
    return (
        f'<figure><img alt="{escape(name)}" src="data:image/svg+xml;base64,{data}">'
        f"<figcaption>{escape(name)}</figcaption></figure>"
    )
