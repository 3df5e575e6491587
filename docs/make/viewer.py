"""Draws docs/images/viewer.png: a replay in the Rerun viewer, rendered without a window.

Needs ``pip install -r requirements/view.txt`` and a Vulkan driver (Mesa's ``lavapipe`` does, Debian's
``mesa-vulkan-drivers``), so ``make docs`` does not run it: ``scripts/in_env python docs/make/viewer.py``.
"""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path

import matplotlib.image
from rerun.experimental import ViewerClient

from tactile_localizer.cli import main

PICTURE = Path(__file__).parents[1] / "images/viewer.png"
SHOWN_S = 2.6
"""Time shown on the timeline, just after contact."""
LOADING_S = 10.0
PORT = 9911
BAR_PX = 37
"""Height of the title bar of the viewer, pixels."""


def make_view(folder: Path) -> Path:
    """Replay a simulated sweep on a simulated bump."""
    os.chdir(folder)
    for command in (
        "simulate bump -o recording",
        "import csv recording/train.csv --scene bump.yaml -o bump_scan",
        "replay recording/test.csv --scan bump_scan --rerun view.rrd",
    ):
        if status := main(command.split()):
            raise SystemExit(status)
    return folder / "view.rrd"


def draw() -> None:
    """Draw the picture."""
    with tempfile.TemporaryDirectory() as folder:
        view, picture = make_view(Path(folder)), Path(folder) / "viewer.png"
        with ViewerClient.spawn(headless=True, port=PORT, hide_welcome_screen=True) as viewer:
            viewer.open(str(view))
            viewer.set_time("time", duration=SHOWN_S, play_state="paused")
            time.sleep(LOADING_S)  # the viewer does not report when it has drawn everything
            viewer.save_screenshot(str(picture))
        matplotlib.image.imsave(PICTURE, matplotlib.image.imread(picture)[BAR_PX:])


if __name__ == "__main__":
    draw()
