"""Conversion of the messages of a bag."""

from functools import partial
from operator import attrgetter
from typing import Any

import numpy as np

from tactile_localizer.errors import MeasurementError
from tactile_localizer.io.bags.reader import Wanted, absolute
from tactile_localizer.io.strain_adapter import StrainAdapter, StrainVector
from tactile_localizer.io.strain_vectors import StrainReader
from tactile_localizer.scene import Scene
from tactile_localizer.streams.palm_frame import PalmFrame
from tactile_localizer.streams.runs import stamp_of, to_ns
from tactile_localizer.streams.sweep_detector import NO_SWEEP
from tactile_localizer.streams.transforms import Transform

TF, TF_STATIC = "/tf", "/tf_static"
_POSES = {
    "geometry_msgs/msg/PoseStamped": "pose",
    "geometry_msgs/msg/PoseWithCovarianceStamped": "pose.pose",
    "nav_msgs/msg/Odometry": "pose.pose",
    "geometry_msgs/msg/TransformStamped": "transform",
}
"""Message types of poses in the frame of the header, and the field of the pose."""


def _sweep_of(message: Any, received_ns: int) -> tuple[int, int]:
    """Stamp after which a ``ScanStatus`` holds, ns, and the sweep that is in progress then."""
    return to_ns(message.header.stamp), int(message.sweep) if message.sweep_active else NO_SWEEP


def _travel_of(message: Any, received_ns: int) -> tuple[int, float]:
    """Stamp of a ``Posterior``, ns, and travel since the last global localization, m."""
    return to_ns(message.header.stamp), float(message.travel)


def _pose_in(pose: Any) -> tuple[float, ...]:
    """Position and quaternion of a ``Pose`` or a ``Transform``."""
    names = ("translation", "rotation") if hasattr(pose, "translation") else ("position", "orientation")
    p, q = (getattr(pose, name) for name in names)
    return (p.x, p.y, p.z, q.x, q.y, q.z, q.w)


def converted_poses(frame: PalmFrame) -> Wanted:
    """Messages of the types of :data:`_POSES` as stamps, ns, and positions of the palm in a frame."""

    def convert(message: Any, received_ns: int) -> tuple[int, np.ndarray]:
        pose, name = _pose_in(attrgetter(_POSES[message.__msgtype__])(message)), message.header.frame_id
        try:
            return stamp_of(message), frame.position(name, pose[:3], pose[3:])
        except MeasurementError as error:
            if name in frame.frames:
                raise
            raise MeasurementError(f"{error}; --material-frame or --reference-frame names another") from None

    return Wanted(tuple(_POSES), convert)


def _transforms(message: Any, received_ns: int) -> list[Transform]:
    """Transforms of a ``TFMessage``."""
    return [
        Transform(
            each.header.frame_id.lstrip("/"),
            each.child_frame_id.lstrip("/"),
            to_ns(each.header.stamp),
            _pose_in(each.transform),
        )
        for each in message.transforms
    ]


CONVERTED = {
    "status": Wanted(("tactile_localizer/msg/ScanStatus",), _sweep_of),
    "posterior": Wanted(("tactile_localizer/msg/Posterior",), _travel_of),
    "active": Wanted(("std_msgs/msg/Bool",), lambda message, received_ns: int(message.data)),
    **dict.fromkeys((TF, TF_STATIC), Wanted(("tf2_msgs/msg/TFMessage",), _transforms)),
}
"""Messages by the names of their topics, but for strain and poses."""


def converted_strain(scene: Scene, topic: str) -> dict[str, Wanted]:
    """``StrainVectors`` reduced to the phalanges of a scene."""
    reader = StrainReader(scene)

    def convert(message: Any, received_ns: int) -> StrainVector:
        return StrainVector(stamp_of(message), *reader.read(message))

    return {topic: Wanted(("tactile_localizer/msg/StrainVectors",), convert)}


def adapted_strain(adapter: StrainAdapter, scene: Scene) -> dict[str, Wanted]:
    """Topics of an adapter, whose messages become strain vectors of the scene's phalanges."""
    rows = scene.rows(adapter.phalanges)
    channels = scene.channels(adapter.phalanges, adapter.layout.counts)
    adapter.reset()

    def convert(topic: str, message: Any, received_ns: int) -> StrainVector | None:
        vector = adapter.feed(topic, message, received_ns)
        return vector and StrainVector(vector.stamp_ns, vector.strain[channels], vector.status[rows])

    return {
        absolute(topic): Wanted((kind,), partial(convert, topic)) for topic, kind in adapter.topics.items()
    }
