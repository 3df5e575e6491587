"""Sections that the reports of a replay and of a scan have in common."""

from collections.abc import Sequence

from tactile_localizer.core.calibration.examination import Examination
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import listed
from tactile_localizer.offline.examination import describe_examination
from tactile_localizer.offline.figures.examination import held_out_figure, score_figure
from tactile_localizer.offline.figures.tactile_map import MapFigures
from tactile_localizer.offline.reports.page import WIDTH_IN, Section, sentence
from tactile_localizer.scene import Scene

_MAP_COLUMNS = 3
"""Maps of channels beside each other."""
_CHANNELS = 15
"""Most channels of a phalanx whose maps are shown."""


def examination_sections(examination: Examination, scene: Scene, found: Sequence[str]) -> list[Section]:
    """How the scan's own sweeps were localized on the map without them; none where none was held out.

    Parameters
    ----------
    examination, scene : of the scan
    found : findings about it, unless the reader has them already
    """
    if not examination.on_map:
        return []
    size_in = WIDTH_IN, 0.8 * WIDTH_IN
    purpose = "Each sweep here was localized on the map made of the others, as an unseen sweep will be"
    lines = [purpose, *describe_examination(scene, examination), *found]
    figures = [
        (held_out_figure(examination, scene, size_in), "Error at the end of each sweep that was left out."),
        (
            score_figure(examination, size_in),
            "How probable the localizer finds what is true (geometric mean along the sweeps; more is "
            "better), by the travel per independent measurement of the position. Grey line: the one chosen.",
        ),
    ]
    return [Section("The examination of the scan", [f"{sentence(line)}." for line in lines], figures)]


def map_section(scan: Scan, scene: Scene, strain_unit: str) -> Section:
    """Maps of the scan: the signal of each phalanx, and, to be unfolded, that of each channel."""
    figures = MapFigures(scan, scene, strain_unit)
    signals = figures.signals(WIDTH_IN)
    channels = figures.channels(_MAP_COLUMNS, WIDTH_IN / _MAP_COLUMNS, _CHANNELS)
    each = [(figure, f"{name.removeprefix('map_')}, by channel") for name, figure in channels.items()]
    return Section(
        "The map",
        lines=[
            "What each finger feels where the palm is: strain above that of featureless material (root mean "
            "square over the channels). Where two places feel the same, touch alone cannot tell them apart."
        ],
        figures=[
            (figure, name.replace("signal", "Strain").replace("_", " of ", 1))
            for name, figure in signals.items()
        ],
        folded=[Section(f"Each channel of {listed(scan.phalanges)}", figures=each)],
    )
