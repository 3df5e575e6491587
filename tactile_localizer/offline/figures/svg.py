"""Figures as SVG elements within a page of HTML."""

from __future__ import annotations

import io
import re
from typing import Any

from matplotlib import rc_context
from matplotlib.figure import Figure

TEXT_PT = 8.0
"""Size of the text of figures in a page, points."""
PAGE_STYLE: dict[Any, Any] = {
    "font.size": TEXT_PT,
    "axes.titlesize": TEXT_PT,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "0.5",
    "svg.fonttype": "none",  # text stays text: it can be searched, and is drawn with the reader's font
}
"""Settings of matplotlib for figures in a page, also while they are made."""


def inline_svg(figure: Figure, name: str) -> str:
    """An SVG element, the same for the same figure.

    Parameters
    ----------
    figure : what is drawn
    name : distinguishes the figures of one page, whose clip paths and markers are found by name
    """
    drawn = io.StringIO()
    with rc_context({**PAGE_STYLE, "svg.hashsalt": name}):
        figure.savefig(drawn, format="svg", metadata={"Date": None, "Creator": None}, dpi=150)
    element = drawn.getvalue()
    element = element[element.index("<svg ") :]
    element = re.sub(r"<metadata>.*?</metadata>", "", element, flags=re.DOTALL)
    return re.sub(r'<g id="[^"]*"', "<g", element)
