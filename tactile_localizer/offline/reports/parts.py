"""Sections that the reports of a replay and of a scan have in common."""

from __future__ import annotations

import matplotlib as mpl

from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import listed
from tactile_localizer.io.recording import Recording
from tactile_localizer.offline.figures.svg import PAGE_STYLE
from tactile_localizer.offline.figures.tactile_map import scan_figures, signal_figures
from tactile_localizer.offline.reports.page import WIDTH_IN, Section, svg
from tactile_localizer.scene import Scene

_MAP_COLUMNS = 3
"""Maps of channels beside each other."""
_CHANNELS = 15
"""Most channels of a phalanx whose maps are shown."""


def map_section(scan: Scan, scene: Scene, recording: Recording) -> Section:
    """What the scan holds: the signal of each phalanx, and folded each channel."""
    unit = recording.sweeps[0].strain_unit if recording.sweeps else "V"
    with mpl.rc_context(PAGE_STYLE):
        signals = signal_figures(scan, scene, unit, (WIDTH_IN, 0.85 * WIDTH_IN))
        size = WIDTH_IN / _MAP_COLUMNS
        channels = scan_figures(scan, scene, unit, _MAP_COLUMNS, size, _CHANNELS)
    each = [
        (svg(figure, name), f"{name.removeprefix('map_')}, by channel") for name, figure in channels.items()
    ]
    return Section(
        "The map",
        lines=[
            "Signal: strain minus that of featureless material, root mean square over the channels. "
            "Where two places have the same strain, touch alone cannot tell them apart."
        ],
        figures=[(svg(figure, name), name.replace("_", " of ", 1)) for name, figure in signals.items()],
        folded=[Section(f"Each channel of {listed(scan.phalanges)}", figures=each)],
    )
