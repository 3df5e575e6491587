"""Shows the map of a scan that is being recorded, without keeping the recording waiting."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import Marker

from tactile_localizer.core.tactile_map import make_map
from tactile_localizer.errors import TactileLocalizerError
from tactile_localizer.io.scan_store import ScanStore
from tactile_localizer.nodes.map_messages import map_cloud, region_marker

LATCHED = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)


class MapPublisher:
    """Publishes ``~/map`` and ``~/feature_region``, latched, from what is committed to a scan file.

    Parameters
    ----------
    node : whose topics they are
    path : the scan file; it is read by a connection of its own
    frame : the material's
    """

    def __init__(self, node: Node, path: Path, frame: str) -> None:
        self._node, self._path, self._frame = node, path, frame
        self._map: Any = node.create_publisher(PointCloud2, "~/map", LATCHED)
        self._region: Any = node.create_publisher(Marker, "~/feature_region", LATCHED)
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
        for made in (self._map, self._region):
            self._node.destroy_publisher(made)

    def _publish(self) -> None:
        try:
            with ScanStore.open(self._path) as store:
                scene = store.scene
                if not any(sweep.pairs and not sweep.dropped for sweep in store.sweeps()):
                    return
                tactile_map = make_map(store.load(), scene)
        except TactileLocalizerError as error:
            self._node.get_logger().warning(f"map: {error}")
            return
        if self._node.context.ok():
            self._map.publish(map_cloud(tactile_map, scene, self._frame))
            self._region.publish(region_marker(scene, self._frame))
