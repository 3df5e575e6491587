"""The report of a scan."""

from collections.abc import Sequence

from tactile_localizer.core.calibration.examination import Examination
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import counted
from tactile_localizer.io.recording import Recording
from tactile_localizer.io.scene_file import scene_to_dict
from tactile_localizer.offline.reports.page import (
    Section,
    file_names,
    html_page,
    page_style,
    versions,
    yaml_text,
)
from tactile_localizer.offline.reports.parts import examination_sections, map_section
from tactile_localizer.scene import Scene


@page_style
def scan_report(
    scan_name: str,
    scan: Scan,
    scene: Scene,
    recording: Recording,
    totals: Sequence[str],
    found: Sequence[str],
    examination: Examination,
) -> str:
    """The report of a scan, HTML.

    Parameters
    ----------
    scan_name : path of the scan
    scan, scene, recording : its pairs, scene and sweeps
    totals : lines of ``scan info``
    found : findings that need attention
    examination : of the scan
    """
    fingers = len(scan.phalanges)
    hand = f"{fingers} phalanges" if fingers > 1 else "1 phalanx"
    return html_page(
        kind="Scan of a material",
        title=file_names(scan_name),
        good=not found,
        verdict=f"{len(found)} findings" if len(found) > 1 else "One finding" if found else "No findings",
        explained="",
        notes=found,
        tiles=[
            (f"{len(scan):,}", "pairs of position and strain"),
            tuple(counted(len(scan.sweep_numbers), "sweep").split()),
            (str(scan.layout.size), f"channels on {hand}"),
        ],
        sections=[
            *examination_sections(examination, scene, ()),
            map_section(scan, scene, recording.sweeps[0].strain_unit if recording.sweeps else "V"),
            Section(
                "Scan and versions",
                code="\n".join(totals),
                folded=[Section("Scene", code=yaml_text(scene_to_dict(scene)))],
                rows=versions(),
            ),
        ],
    )
