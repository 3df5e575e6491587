"""Rendering of a page in a headless Chromium."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from html import unescape
from pathlib import Path
from typing import Any

import pytest

_NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome", "chrome-headless-shell")

_PROBE = """
<script>
addEventListener("load", () => {
  const images = [...document.images].map(
    i => ({name: i.alt, width: i.naturalWidth, shown: i.clientWidth}));
  const loaded = performance.getEntriesByType("resource")
    .map(r => r.name).filter(n => !n.startsWith("data:"));
  const root = document.documentElement;
  const found = {images, loaded, width: root.scrollWidth, view: root.clientWidth};
  parent.postMessage(JSON.stringify(found), "*");
});
</script>
"""

_FRAME = """<body><script>onmessage = e => {{ document.body.dataset.found = e.data; }};</script>
<iframe src="probed.html" style="width: {width}px; height: 800px; border: 0"></iframe></body>
"""


def look_at(page: Path, folder: Path, width: int = 1200) -> dict[str, Any]:
    """Open a page ``width`` pixels wide and describe what is shown.

    Returns
    -------
    dict
        ``images`` with name, natural and shown width; ``loaded``: addresses fetched from outside the page;
        ``width`` of the page and of the ``view`` on it.
    """
    browser = next((path for name in _NAMES if (path := shutil.which(name))), None)
    if browser is None:
        pytest.skip("no Chromium is installed (Debian package chromium)")
    probed = folder / "probed.html"
    probed.write_text(
        page.read_text(encoding="utf-8").replace("</body>", f"{_PROBE}</body>"), encoding="utf-8"
    )
    # A frame, because a headless window cannot be as narrow as a phone.
    frame = folder / "frame.html"
    frame.write_text(_FRAME.format(width=width), encoding="utf-8")
    command = [
        browser,
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        f"--user-data-dir={folder / 'profile'}",
    ]
    command += ["--virtual-time-budget=5000", "--dump-dom", f"file://{frame}"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    found = re.search(r'data-found="([^"]*)"', done.stdout)
    assert found, f"the page did not load: {done.stderr[-500:]}"
    return json.loads(unescape(found.group(1)))
