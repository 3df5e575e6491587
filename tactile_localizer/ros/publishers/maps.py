"""Publishes the map of a scan: one that is given, or one that is being recorded, without holding that up."""

from __future__ import annotations

import threading
from pathlib import Path

from rclpy.lifecycle import LifecycleNodeMixin
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import Marker

from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.tactile_map import make_map
from tactile_localizer.errors import TactileLocalizerError
from tactile_localizer.io.scans.store import ScanStore
from tactile_localizer.ros.conversions.maps import map_cloud, region_marker
from tactile_localizer.scene import Scene

_LATCHED = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)

_SHOWN_PAIRS = 20_000
"""Most pairs that the map of a recording is made from, so that it takes no more memory the longer that is."""


class MapPublisher:
    """Publishes ``~/map`` and ``~/feature_region`` while the node is active, kept for late subscribers.

    Parameters
    ----------
    node : whose topics they are
    frame : the material's
    """

    def __init__(self, node: LifecycleNodeMixin, frame: str) -> None:
        self._node, self._frame = node, frame
        self._map = node.create_lifecycle_publisher(PointCloud2, "~/map", _LATCHED)
        self._region = node.create_lifecycle_publisher(Marker, "~/feature_region", _LATCHED)

    def publish(self, scan: Scan, scene: Scene) -> None:
        """The scan's map, and the region of the feature where the scene has one."""
        cloud = map_cloud(make_map(scan, scene), scene, self._frame)
        if self._node.context.ok():  # it may have taken a while
            self._map.publish(cloud)
            self._region.publish(region_marker(scene, self._frame))

    def close(self) -> None:
        """Withdraw the topics."""
        for made in (self._map, self._region):
            self._node.destroy_lifecycle_publisher(made)


class RecordedMap:
    """Publishes the map of what is committed to a scan file.

    Parameters
    ----------
    node : whose topics they are
    path : the scan file; it is read by a connection of its own
    frame : the material's
    """

    def __init__(self, node: LifecycleNodeMixin, path: Path, frame: str) -> None:
        self._node, self._path = node, path
        self._publisher = MapPublisher(node, frame)
        self._thread: threading.Thread | None = None

    def refresh(self) -> None:
        """Make the map in the background; while one is being made, nothing happens."""
        if self._thread is None or not self._thread.is_alive():
            self._thread = threading.Thread(target=self._publish, name="tactile map", daemon=True)
            self._thread.start()

    def close(self) -> None:
        """Wait for the map that is being made and withdraw the topics."""
        if self._thread is not None:
            self._thread.join()
        self._publisher.close()

    def _publish(self) -> None:
        try:
            with ScanStore.open(self._path) as store:
                if any(sweep.pairs and not sweep.dropped for sweep in store.sweeps()):
                    self._publisher.publish(store.load(_SHOWN_PAIRS), store.scene)
        except TactileLocalizerError as error:
            self._node.get_logger().warning(f"map: {error}")
