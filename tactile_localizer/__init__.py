"""Localization of a robot hand on flexible material by touch.

The public names (:data:`__all__`) are imported from here and need no ROS::

    from tactile_localizer import load_scan, make_localizer, read_recording

    scan, scene = load_scan("bump_scan")
    localizer = make_localizer(scan, scene, scan_file="bump_scan")
    for sample in read_recording("test.csv.gz", scene).sweeps[0].samples():
        estimate = localizer.update(*sample)
    print("true", sample[1], "error", estimate.mean - sample[1], estimate.reason)

Layers, lowest first: :mod:`~tactile_localizer.core` (numpy and scipy only), then
:mod:`~tactile_localizer.io` (files and CAN), :mod:`~tactile_localizer.sim` and
:mod:`~tactile_localizer.offline`, then :mod:`~tactile_localizer.ros` (the only layer that
imports rclpy) and :mod:`~tactile_localizer.cli`. No layer imports one that comes after it.
"""

import importlib
import re
from pkgutil import extend_path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tactile_localizer.core.configuration import Configuration
    from tactile_localizer.core.hypotheses.convergence import State
    from tactile_localizer.core.localizer import Estimate, Localizer
    from tactile_localizer.core.scan.scan import Scan
    from tactile_localizer.errors import TactileLocalizerError
    from tactile_localizer.io.recording import RecordedSweep, Recording
    from tactile_localizer.io.scene_file import load_scene
    from tactile_localizer.library import load_scan, make_localizer, read_recording
    from tactile_localizer.scene import Axis, Phalanx, Region, Scene

    __version__: str

# The generated messages (tactile_localizer.msg) are in the installed package, which a source tree on sys.path
# would otherwise hide.
__path__ = extend_path(__path__, __name__)

__all__ = [
    "Axis",
    "Configuration",
    "Estimate",
    "Localizer",
    "Phalanx",
    "RecordedSweep",
    "Recording",
    "Region",
    "Scan",
    "Scene",
    "State",
    "TactileLocalizerError",
    "load_scan",
    "load_scene",
    "make_localizer",
    "read_recording",
]

_MODULES = {
    "core.configuration": ("Configuration",),
    "core.hypotheses.convergence": ("State",),
    "core.localizer": ("Estimate", "Localizer"),
    "core.scan.scan": ("Scan",),
    "errors": ("TactileLocalizerError",),
    "io.recording": ("RecordedSweep", "Recording"),
    "io.scene_file": ("load_scene",),
    "library": ("load_scan", "make_localizer", "read_recording"),
    "scene": ("Axis", "Phalanx", "Region", "Scene"),
}


def __getattr__(name: str) -> Any:
    """Import a public name on first access, so that unused modules cost no start-up time."""
    if name == "__version__":
        return _version()
    for module, names in _MODULES.items():
        if name in names:
            return getattr(importlib.import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def _version() -> str:
    """The version in ``package.xml``, or in the metadata of a wheel, which has it from there."""
    from tactile_localizer.resources import resource_path

    try:
        manifest = resource_path("package.xml").read_text(encoding="utf-8")
    except FileNotFoundError:
        return str(importlib.import_module("importlib.metadata").version("tactile-localizer"))
    return re.findall("<version>(.+)</version>", manifest)[0]


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
