"""The tactile map and the feature's region as messages for RViz and Foxglove, on the material itself."""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import Point
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker

from tactile_localizer.core.geometry.phalanges import turned_offsets
from tactile_localizer.core.scan.tactile_map import TactileMap
from tactile_localizer.ros.conversions.posteriors import cloud
from tactile_localizer.scene import Scene

_LAYER_M = 0.0005
_TURNS = 33
"""Angles of the palm at which its phalanges are looked up to see how far they reach."""
_LINE_M = 0.0006
_FEATURE = ColorRGBA(r=0.1, g=0.4, b=0.9, a=0.9)


def map_cloud(tactile_map: TactileMap, scene: Scene, frame: str) -> PointCloud2:
    """A map as points where each phalanx was on the material, one thin layer a phalanx.

    Fields: x, y, z (m); ``felt``, how far the strain is from that of featureless material (norm over the
    channels), to colour by; ``element_1``, ``element_2``, ..., NaN where a phalanx has fewer channels than
    another; ``phalanx``, its number in the scene.

    Parameters
    ----------
    tactile_map : over x, over y, or over both
    scene : says where the phalanges sit
    frame : the material's
    """
    covered = tactile_map.covered
    count = np.count_nonzero(covered)
    places, values = [], []
    for number, phalanx in enumerate(scene.phalanges):
        elements = tactile_map.phalanx(phalanx.name)[covered]
        felt = np.linalg.norm(elements, axis=1)
        places.append(tactile_map.places(scene, phalanx)[covered])
        unused = np.full((count, max(scene.layout.counts) - phalanx.channels), np.nan)
        values.append(np.column_stack([np.full(count, -number * _LAYER_M), felt, elements, unused]))
    columns = np.concatenate(values).T
    fields = {"z": columns[0], "felt": columns[1]}
    fields |= {f"element_{element}": column for element, column in enumerate(columns[2:], start=1)}
    fields["phalanx"] = np.repeat(np.arange(len(places)), count)
    return cloud(0, np.concatenate(places), tactile_map.axes, frame, **fields)


def region_marker(scene: Scene, frame: str) -> Marker:
    """The outline of the feature's region on the material, or the order to remove it where there is none.

    A side without a limit lies at the farthest place that a phalanx comes to.
    """
    marker = Marker(type=Marker.LINE_STRIP, ns="feature region", color=_FEATURE)
    marker.header.frame_id = frame
    marker.pose.orientation.w = 1.0
    marker.scale.x = _LINE_M
    if scene.feature is None:
        marker.action = Marker.DELETE
        return marker
    turns = np.linspace(scene.lower, scene.upper, _TURNS)
    offsets = np.concatenate([turned_offsets(scene, phalanx, turns) for phalanx in scene.phalanges])
    lower = np.maximum(scene.feature.lower, scene.lower + offsets.min(axis=0))
    upper = np.minimum(scene.feature.upper, scene.upper + offsets.max(axis=0))
    low, high = (
        {"x": 0.0, "y": 0.0} | dict(zip(scene.axis_names, end.tolist(), strict=True))
        for end in (lower, upper)
    )
    corners = [(low, low), (high, low), (high, high), (low, high), (low, low)]
    marker.points = [Point(x=x["x"], y=y["y"], z=0.001) for x, y in corners]
    return marker
