"""Reading a bag as a recording: strain and palm poses, paired by their stamps exactly as live."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tactile_localizer.core.geometry.palm_frame import PalmFrame
from tactile_localizer.core.geometry.synchronization import DEFAULT_MAX_GAP_S, interpolate_poses
from tactile_localizer.core.scan.sweep_detector import SweepDetector
from tactile_localizer.errors import MeasurementError, ScanError
from tactile_localizer.io.bags.reader import Wanted, read_messages
from tactile_localizer.io.bags.sweeps import (
    TOPICS,
    WHOLE_BAG,
    Span,
    change_of_activity,
    change_of_status,
    localized_spans,
    moving_spans,
    spans,
    stamp_of,
    travel_of,
)
from tactile_localizer.io.recording import RecordedSweep, Recording, in_order
from tactile_localizer.io.strain_adapter import StrainAdapter, StrainVector
from tactile_localizer.io.strain_vectors import StrainReader
from tactile_localizer.scene import Scene


def read_bag(
    path: str | Path,
    scene: Scene,
    *,
    topics: Mapping[str, str] | None = None,
    frame: PalmFrame | None = None,
    max_gap_s: float = DEFAULT_MAX_GAP_S,
    by_status: bool = True,
    detector: SweepDetector | None = None,
    adapter: StrainAdapter | None = None,
) -> Recording:
    """Read a bag as a recording.

    Parameters
    ----------
    path : directory or file, SQLite or MCAP
    scene : axes and phalanges to read
    topics : those with other names than in :data:`~tactile_localizer.io.bags.sweeps.TOPICS`
    frame : frames in which palm poses are accepted; default: ``material``, and ``base_link`` untransformed
    max_gap_s : longest gap between poses that is interpolated, s
    by_status : if true, take the sweeps from the mapping node's status; if false, those of the localization:
        while the topic ``active`` is true, or else from each global localization in the filter node's
        posterior. A bag without these topics is one sweep
    detector : detects the sweeps in the motion instead
    adapter : converts messages of other types to strain, in place of the topic ``strain``

    Returns
    -------
    Recording
        Strain samples with a position, by sweep; ``gaps`` counts the samples without one. ``truth`` is
        ``None`` if the bag has no such topic, and NaN in its gaps. The notes count unreadable messages.

    Raises
    ------
    ScanError
        The bag cannot be read, or has no strain or no poses.
    SceneError
        The messages or the adapter lack a phalanx of the scene, or have other channels for it.
    """
    default = {name: topic for name, (topic, _) in TOPICS.items()}
    names = {name: f"/{topic.lstrip('/')}" for name, topic in {**default, **(topics or {})}.items()}
    frame = frame or PalmFrame(scene.axes, reference_frame="base_link")
    strains = _strain(scene, names["strain"]) if adapter is None else _adapted(adapter, scene)
    names["strain"] = next(iter(strains))
    wanted = {names[name]: each for name, each in _OTHERS.items()}
    if len(wanted | strains) < len(_OTHERS) + len(strains):
        raise ScanError(f"topics: expected different ones, got {', '.join([*names.values(), *strains])}")
    messages = read_messages(path, wanted | strains)
    notes, found = messages.notes(), {name: messages.by_topic.get(topic, []) for name, topic in names.items()}
    for name in ("strain", "pose"):
        if not found[name]:
            there = ", ".join(f"{topic} ({kind})" for topic, kind in sorted(messages.topics.items()))
            reasons = "; ".join([there or "no topics", *notes])
            raise ScanError(f"{path}: expected messages of {names[name]}, found {reasons}")
    stamp_ns, strain, status = map(np.array, zip(*found["strain"], strict=True))
    rows = in_order(stamp_ns, "strain vectors", notes, 0)
    stamp_ns, strain, status = stamp_ns[rows], strain[rows], status[rows]

    def palm_positions(name: str) -> tuple[np.ndarray, np.ndarray]:
        pose_ns, poses = _positions(found[name], frame, names[name], notes)
        return interpolate_poses(scene.axes, pose_ns, poses, stamp_ns, max_gap_s)

    position, has_position = palm_positions("pose")
    truth = palm_positions("truth")[0] if found["truth"] else None
    if detector is not None:
        sweeps = moving_spans(detector, stamp_ns[has_position], position[has_position])
    elif by_status:
        sweeps = spans(found["status"]) if found["status"] else [WHOLE_BAG]
    else:
        sweeps = localized_spans(found["active"], found["posterior"])
    samples = RecordedSweep(WHOLE_BAG.number, stamp_ns, position, strain, status, truth)
    return Recording(
        str(path),
        tuple(_sweep(samples, has_position, span) for span in sweeps),
        tuple(notes),
        sum(count for count, _ in messages.invalid.values()),
    )


def _sweep(samples: RecordedSweep, has_position: np.ndarray, span: Span) -> RecordedSweep:
    """The samples of a span that have a position; samples without one are counted as gaps."""
    inside = (samples.stamp_ns > span.after_ns) & (samples.stamp_ns <= span.until_ns)
    return samples.part(inside & has_position, span.number, gaps=int(np.sum(inside & ~has_position)))


def _pose(message: Any, received_ns: int) -> tuple[str, int, tuple[float, ...]]:
    """Frame, stamp (ns), position and quaternion of a ``PoseStamped``."""
    p, q = message.pose.position, message.pose.orientation
    return message.header.frame_id, stamp_of(message), (p.x, p.y, p.z, q.x, q.y, q.z, q.w)


_OTHERS = {
    "pose": Wanted("geometry_msgs/msg/PoseStamped", _pose),
    "truth": Wanted("geometry_msgs/msg/PoseStamped", _pose),
    "status": Wanted("tactile_localizer/msg/ScanStatus", change_of_status),
    "posterior": Wanted("tactile_localizer/msg/Posterior", travel_of),
    "active": Wanted("std_msgs/msg/Bool", change_of_activity),
}
"""Messages by the names of their topics, but for the strain."""


def _positions(
    poses: Sequence[tuple[str, int, tuple[float, ...]]], frame: PalmFrame, topic: str, notes: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Stamps (m,), ns, and palm positions (m, d), m (yaw: rad), of the poses in a known frame."""
    names, stamp_ns, numbers = (np.array(each) for each in zip(*poses, strict=True))
    position = np.full((len(names), frame.dimension), np.nan)
    reason = "not finite"
    for name in np.unique(names).tolist():
        rows = names == name
        try:
            position[rows] = frame.positions(name, numbers[rows, :3], numbers[rows, 3:])
        except MeasurementError as error:
            reason = str(error)
    valid = np.isfinite(position).all(axis=1)
    if not valid.all():
        notes.append(f"skipped {np.sum(~valid)} of {len(valid)} poses of {topic}: {reason}")
    stamp_ns, position = stamp_ns[valid], position[valid]
    rows = in_order(stamp_ns, f"poses of {topic}", notes, 0)
    return stamp_ns[rows], position[rows]


def _strain(scene: Scene, topic: str) -> dict[str, Wanted]:
    """``StrainVectors`` reduced to the phalanges of a scene."""
    reader = StrainReader(scene)

    def convert(message: Any, received_ns: int) -> StrainVector:
        return StrainVector(stamp_of(message), *reader.read(message))

    return {topic: Wanted("tactile_localizer/msg/StrainVectors", convert)}


def _adapted(adapter: StrainAdapter, scene: Scene) -> dict[str, Wanted]:
    """Topics of an adapter, whose messages become strain vectors of the scene's phalanges."""
    rows = scene.rows(adapter.phalanges)
    channels = scene.channels(adapter.phalanges, adapter.layout.counts)
    adapter.reset()

    def convert(topic: str, message: Any, received_ns: int) -> StrainVector | None:
        vector = adapter.feed(topic, message, received_ns)
        return vector and StrainVector(vector.stamp_ns, vector.strain[channels], vector.status[rows])

    return {
        f"/{topic.lstrip('/')}": Wanted(kind, partial(convert, topic))
        for topic, kind in adapter.topics.items()
    }
