"""Publisher of the tactile map, of a complete scan or of one that is being recorded."""

import math
from pathlib import Path

import numpy as np
from sensor_msgs.msg import PointCloud2

from tactile_localizer.core.scan.tactile_map import TactileMap, make_map
from tactile_localizer.io.scans.folder import ScanFolder
from tactile_localizer.ros.base.background import run_in_thread
from tactile_localizer.ros.base.exception_guards import one_line
from tactile_localizer.ros.base.managed_node import ManagedNode
from tactile_localizer.ros.base.qos import LATCHED
from tactile_localizer.ros.publishers.estimates import cloud

_LAYER_M = 0.0005


def map_cloud(tactile_map: TactileMap, frame: str) -> PointCloud2:
    """The tactile map as a point cloud at the phalanx positions on the material, one layer per phalanx.

    Fields: x, y, z (m); ``intensity``, the norm over the channels of the strain relative to featureless
    material, for colouring; ``element_1``, ``element_2``, ..., NaN for channels that a phalanx lacks;
    ``phalanx``, the index of the phalanx in the scene.

    Parameters
    ----------
    tactile_map : map over x, y, or both
    frame : frame of the material
    """
    scene, covered = tactile_map.scene, tactile_map.covered
    count = np.count_nonzero(covered)
    positions, values = [], []
    for number, phalanx in enumerate(scene.phalanges):
        elements = tactile_map.phalanx(phalanx.name)[covered]
        intensity = np.linalg.norm(elements, axis=1)
        positions.append(tactile_map.places(phalanx)[covered])
        unused = np.full((count, max(scene.layout.counts) - phalanx.channels), np.nan)
        values.append(np.column_stack([np.full(count, -number * _LAYER_M), intensity, elements, unused]))
    columns = np.concatenate(values).T
    fields = {"z": columns[0], "intensity": columns[1]}
    fields |= {f"element_{element}": column for element, column in enumerate(columns[2:], start=1)}
    fields["phalanx"] = np.repeat(np.arange(len(positions)), count)
    return cloud(0, np.concatenate(positions), tactile_map.axes, frame, **fields)


_MAX_PAIRS = 20_000
"""Largest number of pairs from which a map is built during a recording, to bound the time."""


class MapPublisher:
    """Publishes ``~/map`` while the node is active, latched for late subscribers.

    Parameters
    ----------
    node : node that publishes
    frame : frame of the material
    """

    def __init__(self, node: ManagedNode, frame: str) -> None:
        self._frame = frame
        self._node, self._is_drawing = node, False
        self._map = node.create_lifecycle_publisher(PointCloud2, "~/map", LATCHED)

    def publish(self, tactile_map: TactileMap) -> None:
        """Publish the map of a scan."""
        self._map.publish(map_cloud(tactile_map, self._frame))

    def publish_folder(self, path: Path) -> None:
        """Publish the map of a scan that is being recorded, made in the background.

        Without effect while such a map is being made.
        """
        if not self._is_drawing and self._node.executor is not None:
            self._is_drawing = True
            self._node.executor.create_task(self._draw(path))

    async def _draw(self, path: Path) -> None:
        def make() -> PointCloud2:
            folder = ScanFolder(path)
            scan = folder.load()
            every = math.ceil(len(scan) / _MAX_PAIRS)
            some = scan.select(np.arange(0, len(scan), every))
            return map_cloud(make_map(some, folder.scene), self._frame)

        try:
            self._map.publish(await run_in_thread(self._node, make))
        except Exception as error:
            self._node.get_logger().warning(f"map: {one_line(error)}")
        finally:
            self._is_drawing = False
