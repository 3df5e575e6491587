"""Publisher of the tactile map, of a complete scan or of one that is being recorded."""

from __future__ import annotations

from pathlib import Path

from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import Marker

from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.tactile_map import make_map
from tactile_localizer.io.scans.store import ScanStore
from tactile_localizer.ros.base.background import BackgroundJob
from tactile_localizer.ros.base.managed_node import ManagedNode
from tactile_localizer.ros.base.qos import LATCHED
from tactile_localizer.ros.conversions.maps import map_cloud, region_marker
from tactile_localizer.scene import Scene

_MAX_PAIRS = 20_000
"""Largest number of pairs from which a map is built during a recording, to bound the memory."""


class MapPublisher:
    """Publishes ``~/map`` and ``~/feature_region`` while the node is active, latched for late subscribers.

    Parameters
    ----------
    node : node that publishes
    frame : frame of the material
    """

    def __init__(self, node: ManagedNode, frame: str) -> None:
        self._frame = frame
        self._job = BackgroundJob(node, "map")
        self._map = node.create_lifecycle_publisher(PointCloud2, "~/map", LATCHED)
        self._region = node.create_lifecycle_publisher(Marker, "~/feature_region", LATCHED)

    def publish(self, scan: Scan, scene: Scene) -> None:
        """Publish the map of a scan, and the feature region if the scene has one."""
        self._publish(self._messages(scan, scene))

    def publish_file(self, path: Path) -> None:
        """Publish the map of the pairs committed to a scan file, made in the background.

        Without effect while such a map is being made.
        """

        def make() -> tuple[PointCloud2, Marker] | None:
            with ScanStore.open(path) as store:
                if not any(sweep.pairs and not sweep.dropped for sweep in store.sweeps()):
                    return None
                return self._messages(store.load(_MAX_PAIRS), store.scene)

        self._job.start(make, self._publish)

    def _messages(self, scan: Scan, scene: Scene) -> tuple[PointCloud2, Marker]:
        cloud = map_cloud(make_map(scan, scene), self._frame)
        return cloud, region_marker(scene, self._frame)

    def _publish(self, messages: tuple[PointCloud2, Marker] | None) -> None:
        if messages is not None and self._map.is_activated:
            self._map.publish(messages[0])
            self._region.publish(messages[1])
