"""Checks of a scan: early endings, implausible motion, coverage, dead channels, a single sweep.

The thresholds are judgement, each with its reason; the user decides what to do about a finding.
"""

from collections.abc import Sequence

import numpy as np

from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import listed
from tactile_localizer.io.recording import ENDED, RecordedSweep
from tactile_localizer.scene import Scene
from tactile_localizer.streams.alternation import alternates
from tactile_localizer.streams.coverage import Coverage
from tactile_localizer.streams.delay import Track
from tactile_localizer.streams.findings import describe_motion
from tactile_localizer.streams.plausible_strain import describe_strain

_MIN_PAIRS = 50
"""Pairs below which a channel cannot be checked."""
_COVERED = 0.5
"""Coverage of the bounds below which it is reported: a margin around the scan is no defect."""
_ANOTHER_UNIT = 0.01
"""Coverage below which the bounds seem to be in another unit; a single line covers more."""
_DEAD = 0.01
"""Range of a dead channel, as a fraction of the median channel's."""


def findings(scan: Scan, scene: Scene, sweeps: Sequence[RecordedSweep]) -> list[str]:
    """Findings about a scan that may need attention, one line for each kind.

    Parameters
    ----------
    scan : the pairs
    scene : its bounds
    sweeps : as stored
    """
    found = []
    if early := [sweep.number for sweep in sweeps if sweep.ending != ENDED]:
        found.append(f"recording ended early: sweep {listed(map(str, early))}")
    motions = [(each, describe_motion(scene.axes, each.stamp_ns, each.position)) for each in sweeps]
    if implausible := [(sweep.number, motion) for sweep, motion in motions if motion]:
        number, motion = implausible[0]
        others = f", and {len(implausible) - 1} of {len(sweeps) - 1} others are implausible"
        found.append(f"{motion} (sweep {number}{others * (len(implausible) > 1)})")
    found += strain_findings(scene, sweeps)
    if len(scan.sweep_numbers) == 1:
        found.append("only one sweep: the noise between sweeps cannot be estimated")
    coverage = Coverage(scene)
    coverage.add(scan.states)
    if coverage.fraction < _COVERED:
        unit = " (bounds in mm?)" if coverage.fraction < _ANOTHER_UNIT else ""
        found.append(f"coverage: only {coverage.fraction:.0%} of the scene's bounds lie near a pair{unit}")
    spread = np.ptp(scan.strain, axis=0)
    if len(scan) >= _MIN_PAIRS and (dead := np.flatnonzero(spread <= _DEAD * np.median(spread)).tolist()):
        places = [scan.layout.place(column) for column in dead]
        names = listed(f"{scan.phalanges[phalanx]} {channel}" for phalanx, channel in places)
        found.append(f"channels that seem dead, of nearly constant strain: {names}")
    return found


def strain_findings(scene: Scene, sweeps: Sequence[RecordedSweep]) -> list[str]:
    """Findings about the strain of sweeps of a scene, one line for each kind."""
    if mixed := [str(each.number) for each in sweeps if alternates(each.strain)]:
        return [f"strain that alternates from sample to sample, of two sources: sweep {listed(mixed)}"]
    places = map(scene.layout.place, range(scene.layout.size))
    names = [f"{scene.phalanx_names[phalanx]} {channel}" for phalanx, channel in places]
    tracks = [Track(each.stamp_ns, each.position, each.strain) for each in sweeps]
    return describe_strain(tracks, names)
