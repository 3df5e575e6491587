"""HTML report in one file, with embedded figures and tables."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path

import matplotlib
from matplotlib.figure import Figure

from tactile_localizer.errors import ScanError
from tactile_localizer.io.whole_file import whole_file
from tactile_localizer.offline.table import Table

_STYLE = """
:root { color-scheme: light; }
body { font: 16px/1.5 system-ui, sans-serif; color: #222; background: #fff; max-width: 70rem; margin: 0 auto;
       padding: 1rem; }
h1 { font-size: 1.6rem; margin: .5rem 0; } h2 { font-size: 1.2rem; margin: 2rem 0 .5rem; }
p { margin: .5rem 0; max-width: 45rem; } .note { color: #555; font-size: .85rem; }
.figures { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(24rem, 100%), 1fr));
           gap: 1rem; }
figure { margin: 0; break-inside: avoid; } img { width: 100%; height: auto; }
figcaption { font-size: .85rem; color: #555; }
.wide { overflow-x: auto; } table { border-collapse: collapse; font-size: .85rem; }
th, td { padding: .25rem .6rem; text-align: right; border-bottom: 1px solid #ddd; white-space: nowrap; }
th { border-bottom: 2px solid #999; } th:first-child, td:first-child { text-align: left; }
.words td, .words th { white-space: normal; text-align: left; vertical-align: top; }
@media (max-width: 40rem) {
  table { font-size: .72rem; } th, td { padding: .2rem .35rem; }
  th { white-space: normal; } th:first-child, td:first-child { white-space: normal; overflow-wrap: anywhere; }
  th:first-child, td:first-child { position: sticky; left: 0; min-width: 6rem; background: #fff; }
  .words thead { display: none; } .words tr, .words td { display: block; border: 0; padding: .05rem 0; }
  .words tr { border-bottom: 1px solid #ddd; padding: .4rem 0; }
}
@media print {
  body { max-width: none; padding: 0; font-size: 10pt; } .wide { overflow: visible; }
  table { font-size: 7pt; } th, td { padding: .1rem .25rem; white-space: normal; overflow-wrap: break-word; }
  tr { break-inside: avoid; } h2 { break-after: avoid; } thead { display: table-header-group; }
  .figures { grid-template-columns: 1fr 1fr; }
}
"""


class Report:
    """HTML page to which sections are added in order.

    Parameters
    ----------
    title : of the page
    summary : paragraph below the title
    """

    def __init__(self, title: str, summary: str) -> None:
        self._title = title
        self._parts = [f"<h1>{escape(title)}</h1>", f"<p>{escape(summary)}</p>"]

    def add_figures(self, heading: str, figures: Mapping[str, Figure], note: str = "") -> None:
        """Add figures by name, side by side where the page is wide enough."""
        pictures = "".join(
            f'<figure><img alt="{escape(name)}" src="{_embedded(figure)}">'
            f"<figcaption>{escape(name)}</figcaption></figure>"
            for name, figure in figures.items()
        )
        self._add(heading, note, f'<div class="figures">{pictures}</div>')

    def add_table(self, table: Table) -> None:
        """Add a table."""
        head = "".join(f"<th>{escape(column)}</th>" for column in table.columns)
        rows = "".join(
            f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in table.rows
        )
        words = any(len(cell) > 60 for row in table.rows for cell in row)
        kind = ' class="words"' if words else ""
        content = f"<table{kind}><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"
        self._add(table.title, table.note, f'<div class="wide">{content}</div>')

    def write(self, path: Path) -> None:
        """Write the page.

        Raises
        ------
        ScanError
            The file cannot be written.
        """
        page = (
            '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
            '<meta name="viewport" content="width=device-width, initial-scale=1">'
            f"<title>{escape(self._title)}</title><style>{_STYLE}</style></head>\n<body>\n"
            + "\n".join(self._parts)
            + "\n</body></html>\n"
        )
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with whole_file(path) as unfinished:
                unfinished.write_text(page, encoding="utf-8")
        except OSError as error:
            raise ScanError(f"{path}: expected to write a report, {error.strerror}") from None

    def _add(self, heading: str, note: str, content: str) -> None:
        caption = f'<p class="note">{escape(note)}</p>' if note else ""
        self._parts.append(f"<section><h2>{escape(heading)}</h2>{caption}{content}</section>")


def mapping_table(title: str, values: Mapping[str, object]) -> Table:
    """A table of names and values."""
    return Table(title, ("", ""), [(name, str(value)) for name, value in values.items()])


def save_figures(figures: Mapping[str, Figure], folder: Path) -> Sequence[Path]:
    """Write figures as PNG files, each under its name.

    Raises
    ------
    ScanError
        A file cannot be written.
    """
    paths = [folder / f"{name}.png" for name in figures]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for path, figure in zip(paths, figures.values(), strict=True):
            figure.savefig(path, dpi=150)
    except OSError as error:
        raise ScanError(f"{folder}: expected to write figures, {error.strerror}") from None
    return paths


def _embedded(figure: Figure) -> str:
    """Figure as a data URL; the same figure gives the same bytes."""
    buffer = io.BytesIO()
    with matplotlib.rc_context({"svg.hashsalt": "tactile_localizer"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    return f"data:image/svg+xml;base64,{base64.b64encode(buffer.getvalue()).decode()}"
