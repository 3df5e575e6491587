"""Writing serialised messages to a bag."""

from __future__ import annotations

from pathlib import Path
from threading import Lock

from rosbags.interfaces import Connection
from rosbags.rosbag2 import StoragePlugin, Writer, WriterError

from tactile_localizer.errors import ScanError
from tactile_localizer.io.bags.reader import typestore


class BagWriter:
    """Writer of an MCAP bag; a context manager that closes the bag. Its calls may come from several threads.

    Parameters
    ----------
    path : directory of the bag; must not exist yet
    topics : message type by topic, such as ``geometry_msgs/msg/PoseStamped``

    Raises
    ------
    ScanError
        The directory exists or cannot be written.
    """

    def __init__(self, path: Path, topics: dict[str, str]) -> None:
        store = typestore()
        self._lock = Lock()
        try:
            self._writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
            self._writer.open()
        except (WriterError, OSError) as error:
            raise ScanError(f"{path}: could not create the bag, {error}") from None
        self._connections: dict[str, Connection] = {
            topic: self._writer.add_connection(topic, kind, typestore=store) for topic, kind in topics.items()
        }

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(self, *error: object) -> None:
        with self._lock:
            self._writer.close()

    def write(self, topic: str, received_ns: int, raw: bytes) -> None:
        """Write a message as received from the middleware, serialised in CDR."""
        with self._lock:
            self._writer.write(self._connections[topic], received_ns, raw)
