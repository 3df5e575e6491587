"""Bags for tests: a hand slides along x, with strain every 5 ms and poses every 20 ms."""

from collections.abc import Callable
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.interfaces import Connection
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from tactile_localizer.io.bags.reader import typestore
from tactile_localizer.scene import Axis, Phalanx, Scene

SCENE = Scene(
    "sheet",
    (Axis("x", 0.0, 0.05), Axis("y", 0.0, 0.05)),
    (Phalanx("index", (0.0, 0.01)), Phalanx("middle", (0.0, -0.01))),
)
MS = 1_000_000
START = 1_700_000_000_000 * MS
TYPES = {
    "strain": "tactile_localizer/msg/StrainVectors",
    "palm_pose": "geometry_msgs/msg/PoseStamped",
    "tactile_simulator/ground_truth": "geometry_msgs/msg/PoseStamped",
    "tactile_mapping/status": "tactile_localizer/msg/ScanStatus",
    "tactile_filter/posterior": "tactile_localizer/msg/Posterior",
    "tactile_simulator/sweep_active": "std_msgs/msg/Bool",
}
STORE = typestore()
_T = STORE.types


def x_at(stamp_ms: np.ndarray | float) -> Any:
    """Position of the hand on x, m."""
    return 0.01 + 0.00001 * np.asarray(stamp_ms)


def _header(stamp_ms: int, frame: str) -> Any:
    total = START + stamp_ms * MS if stamp_ms else 0
    stamp = _T["builtin_interfaces/msg/Time"](sec=total // 10**9, nanosec=total % 10**9)
    return _T["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)


def strain(stamp_ms: int, phalanges: tuple[str, ...] = ("middle", "index"), **changes: Any) -> Any:
    n = len(phalanges)
    values = {
        "header": _header(stamp_ms, ""),
        "phalanges": list(phalanges),
        "strain": np.arange(8.0 * n) * 1000 + stamp_ms,
        "status": np.zeros(n, dtype=np.uint8),
        "sequence": np.full(n, stamp_ms, dtype=np.uint32),
        "channels": np.zeros(0, dtype=np.uint16),
    }
    return _T[TYPES["strain"]](**{**values, **changes})


def pose(stamp_ms: int, frame: str = "material", x: float | None = None, y: float = 0.02) -> Any:
    place = _T["geometry_msgs/msg/Point"](x=float(x_at(stamp_ms) if x is None else x), y=float(y), z=0.0)
    turn = _T["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
    pose = _T["geometry_msgs/msg/Pose"](position=place, orientation=turn)
    return _T[TYPES["palm_pose"]](header=_header(stamp_ms, frame), pose=pose)


def status(stamp_ms: int, active: bool, number: int) -> Any:
    zero: dict[str, Any] = dict.fromkeys(("sweeps", "samples", "gaps", "skipped"), 0)
    zero |= {"scan_file": "", "scene": "sheet", "coverage": 0.0, "rate": 0.0}
    header = _header(stamp_ms, "material")
    return _T[TYPES["tactile_mapping/status"]](header=header, sweep_active=active, sweep=number, **zero)


def posterior(stamp_ms: int, travel: float) -> Any:
    numbers = dict.fromkeys(
        ("covariance_trace", "probability", "on_map", "log_marginal", "effective_sample_size"), 0.0
    )
    return _T[TYPES["tactile_filter/posterior"]](
        header=_header(stamp_ms, "material"),
        state=1,
        axes=["x", "y"],
        mean=np.zeros(2),
        covariance=np.zeros(4),
        converged=False,
        reason=f"not converged: {travel} m",
        particles=1,
        travel=travel,
        stale=False,
        **numbers,
    )


def slide(first_ms: int, last_ms: int) -> list[tuple[str, int, Any]]:
    """Topic, time of receipt (ms) and message of everything after ``first_ms`` up to ``last_ms``."""
    happened: list[tuple[str, int, Any]] = []
    for stamp_ms in range(first_ms + 1, last_ms + 1):
        if stamp_ms % 5 == 0:
            happened.append(("strain", stamp_ms, strain(stamp_ms)))
        if stamp_ms % 20 == 0:
            happened.append(("palm_pose", stamp_ms, pose(stamp_ms)))
    return happened


def moved(
    happened: list[tuple[str, int, Any]], x: Callable[[int], float] | None = None, frame: str = "material"
) -> list[tuple[str, int, Any]]:
    """The same with other poses; ``x`` gives the position at a time in ms."""
    return [
        (topic, ms, pose(ms, frame, x and x(ms)) if topic == "palm_pose" else message)
        for topic, ms, message in happened
    ]


def file_of(bag: Path) -> Path:
    """The file of messages of a bag directory that has one."""
    (file,) = (path for path in bag.iterdir() if path.name != "metadata.yaml")
    return file


def write_bag(
    path: Path,
    happened: list[tuple[str, int, Any]],
    storage: str = "mcap",
    compression: str = "none",
    slash: str = "/",
    *,
    store: Any = STORE,
    defined: bool = True,
    by_receipt: bool = True,
) -> Path:
    """Write a bag directory; messages given as bytes are written as they are.

    Parameters
    ----------
    happened : topic, time of receipt (ms) and message
    store : knows the types of the messages
    defined : whether the bag has the definitions of its messages
    by_receipt : whether the order is that of receipt, or that of ``happened``
    """
    definition = {"typestore": store} if defined else {"msgdef": "", "rihs01": "RIHS01_" + 64 * "0"}
    writer = Writer(path, version=9, storage_plugin=StoragePlugin[storage.upper()])
    if compression != "none":
        writer.set_compression(CompressionMode[compression.upper()], CompressionFormat.ZSTD)
    topics: dict[str, Connection] = {}
    with writer:
        for topic, received_ms, message in sorted(happened, key=itemgetter(1)) if by_receipt else happened:
            kind = getattr(message, "__msgtype__", None) or TYPES[topic]
            if topic not in topics:
                topics[topic] = writer.add_connection(slash + topic, kind, **definition)
            raw = message if isinstance(message, bytes) else store.serialize_cdr(message, kind)
            writer.write(topics[topic], START + received_ms * MS, raw)
    return path
