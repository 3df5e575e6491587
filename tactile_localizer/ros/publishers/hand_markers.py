"""Conversion of an estimate to markers of the hand for RViz and Foxglove."""

import math

import numpy as np
from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from tactile_localizer.core.geometry.phalanges import phalanx_positions
from tactile_localizer.core.localizer import Estimate
from tactile_localizer.ros.conversions import from_ns
from tactile_localizer.scene import Scene

_PAD_M = 0.012
_TEXT_M = 0.003
_THICKNESS_M = 0.0005
_CONVERGED = ColorRGBA(r=0.1, g=0.7, b=0.2, a=0.6)
_NOT_CONVERGED = ColorRGBA(r=0.95, g=0.6, b=0.1, a=0.6)
_STALE = ColorRGBA(r=0.5, g=0.5, b=0.5, a=0.5)
_ELLIPSE = 2.4477
"""Mahalanobis radius that contains 95 % of a two-dimensional Gaussian."""


def markers(estimate: Estimate, scene: Scene, frame: str, stale: str) -> MarkerArray:
    """Phalanges at the estimated position, 95 % ellipse of the palm, and the reason of the decision as text.

    Parameters
    ----------
    estimate : estimate to display
    scene : scene with the phalanx offsets
    frame : frame of the material
    stale : reason why the estimate is stale; empty if it is not
    """
    x, y = planar(scene.axis_names, estimate.mean)
    color = _STALE if stale else _CONVERGED if estimate.converged else _NOT_CONVERGED
    pads = Marker(type=Marker.SPHERE_LIST, ns="phalanges", color=color)
    pads.scale.x = pads.scale.y = pads.scale.z = _PAD_M
    for phalanx in scene.phalanges:
        along, across = planar(scene.axis_names, phalanx_positions(scene, phalanx, estimate.mean[None])[0])
        pads.points.append(Point(x=along, y=across))
    text = Marker(type=Marker.TEXT_VIEW_FACING, ns="reason", color=ColorRGBA(r=1.0, g=1.0, b=1.0, a=1.0))
    text.text = f"stale: {stale}" if stale else estimate.reason
    centre, top = (
        planar(scene.axis_names, limits) for limits in ((scene.lower + scene.upper) / 2, scene.upper)
    )
    text.pose = Pose(position=Point(x=centre[0], y=top[1] + _TEXT_M, z=0.02))
    text.scale.z = _TEXT_M
    shown = [pads, _ellipse(estimate, scene, (x, y), color), text]
    for number, marker in enumerate(shown):
        marker.id = number
        marker.header.frame_id = frame
        marker.header.stamp = from_ns(estimate.stamp_ns)
    return MarkerArray(markers=shown)


def _ellipse(estimate: Estimate, scene: Scene, centre: tuple[float, float], color: ColorRGBA) -> Marker:
    """The 95 % ellipse of the palm on the modelled axes of x and y."""
    columns = [i for i, name in enumerate(scene.axis_names) if name != "yaw"]
    rows = ["xy".index(scene.axis_names[i]) for i in columns]
    covariance = np.zeros((2, 2))
    covariance[np.ix_(rows, rows)] = estimate.covariance[np.ix_(columns, columns)]
    values, vectors = np.linalg.eigh(covariance)
    diameters = 2 * _ELLIPSE * np.sqrt(np.maximum(values, 0.0))
    half_turn = math.atan2(vectors[1, 0], vectors[0, 0]) / 2
    marker = Marker(type=Marker.CYLINDER, ns="covariance", color=color)
    marker.scale = Vector3(x=float(diameters[0]), y=float(diameters[1]), z=_THICKNESS_M)
    marker.pose.position = Point(x=centre[0], y=centre[1])
    marker.pose.orientation = Quaternion(z=math.sin(half_turn), w=math.cos(half_turn))
    return marker


def planar(axes: tuple[str, ...], values: np.ndarray) -> tuple[float, float]:
    """x and y of a state; zero for an unmodelled axis."""
    by_axis = dict(zip(axes, values.tolist(), strict=True))
    return by_axis.get("x", 0.0), by_axis.get("y", 0.0)
