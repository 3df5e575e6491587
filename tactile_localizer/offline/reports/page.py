"""The page of a report: sections of text, figures and tables, rendered by a template."""

from __future__ import annotations

import io
import platform
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
import scipy
import yaml
from markupsafe import Markup
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from tactile_localizer import __version__
from tactile_localizer.io.whole_file import RESULT

WIDTH_IN = 4.7
"""Width of a figure, inches: two beside each other on a desk, one at nearly its size on a telephone."""
_MARGIN_IN = 0.05
"""Margin above and below a figure, inches."""
_TEXT_PT = 8.0
"""Size of the text of figures, points."""
_STYLE: dict[Any, Any] = {
    "font.size": _TEXT_PT,
    "axes.titlesize": _TEXT_PT,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "0.5",
    "svg.fonttype": "none",  # text stays text: it can be searched, and is drawn with the reader's font
}
page_style = rc_context(_STYLE)
"""Decorator of a function that makes a page, with matplotlib's settings for the figures in it."""


@dataclass(frozen=True)
class Section:
    """A part of a report: paragraphs, then figures, a table and text as it is in a file.

    Parameters
    ----------
    title : heading
    lines : paragraphs
    figures : figures with their captions, which differ from those of all others of the page
    columns : headings of the table; empty: none
    numbers : those of them whose cells are numbers
    rows : ``good``, ``bad`` or ``""``, and the cells of a row, the first its heading
    code : text whose lines and spaces are kept
    folded : parts that the reader opens
    """

    title: str
    lines: Sequence[str] = ()
    figures: Sequence[tuple[Figure, str]] = ()
    columns: Sequence[str] = ()
    numbers: Sequence[str] = ()
    rows: Sequence[tuple[str, Sequence[str]]] = ()
    code: str = ""
    folded: Sequence[Section] = ()


def html_page(**values: Any) -> str:
    """The page of the template, made now."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("tactile_localizer.offline.reports"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["svg"] = _svg
    made = datetime.now(timezone.utc).strftime("%Y-%m-%d %H:%M UTC")
    return environment.get_template("report.html").render(values, mark=RESULT, version=__version__, made=made)


def versions() -> list[tuple[str, tuple[str, str]]]:
    """Rows of the package's and the libraries' versions."""
    libraries = f"Python {platform.python_version()}, numpy {np.__version__}, scipy {scipy.__version__}"
    return [("", ("tactile_localizer", __version__)), ("", ("with", f"{libraries}, {platform.system()}"))]


def _svg(figure: Figure, caption: str) -> Markup:
    """An SVG element, the same for the same figure; clip paths and markers are named by the caption."""
    drawn = io.StringIO()
    with rc_context({"svg.hashsalt": caption}):
        figure.savefig(
            drawn,
            format="svg",
            metadata={"Date": None, "Creator": None},
            dpi=150,
            bbox_inches=_without_margins(figure),
        )
    element = drawn.getvalue()
    element = element[element.index("<svg ") :]
    element = re.sub(r"<metadata>.*?</metadata>", "", element, flags=re.DOTALL)
    return Markup(re.sub(r'<g id="[^"]*"', "<g", element))


def _without_margins(figure: Figure) -> Bbox:
    """Box of a figure's whole width without what is empty above and below, inches."""
    figure.draw_without_rendering()
    drawn = figure.get_tightbbox()
    return Bbox([[0.0, drawn.y0 - _MARGIN_IN], [figure.get_figwidth(), drawn.y1 + _MARGIN_IN]])


def sentence(text: str) -> str:
    """A text that begins with an upper-case letter."""
    return text[:1].upper() + text[1:]


def file_names(paths: str) -> str:
    """The names of files without their folders."""
    return ", ".join(Path(path).resolve().name for path in paths.split(", "))


def yaml_text(value: Mapping[str, Any]) -> str:
    """A mapping as in a file of the user, to be copied."""
    return yaml.safe_dump(dict(value), sort_keys=False)
