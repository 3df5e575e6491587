"""Recordings in bags: strain and palm poses, paired by their stamps as they would have been live."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rosbags.highlevel import AnyReader

from tactile_localizer.core.geometry.palm_frame import PalmFrame
from tactile_localizer.core.geometry.pose_buffer import DEFAULT_MAX_GAP_S, interpolate_poses
from tactile_localizer.core.scan.sweep_detector import SweepDetector
from tactile_localizer.errors import MeasurementError, ScanError
from tactile_localizer.io.bags.decode import PoseDecoder, Poses, StrainDecoder, Strains
from tactile_localizer.io.bags.reader import BagMessages, read_messages, typestore
from tactile_localizer.io.bags.sweeps import (
    WHOLE,
    Change,
    Span,
    Travel,
    held_spans,
    moving_spans,
    status_spans,
)
from tactile_localizer.io.recording import RecordedSweep, Recording
from tactile_localizer.io.strain_adapter import StrainAdapter
from tactile_localizer.scene import Scene


@dataclass(frozen=True)
class BagTopics:
    """Where a bag has what is wanted.

    Parameters
    ----------
    strain : ``StrainVectors``
    pose : ``PoseStamped`` of the palm
    truth : ``PoseStamped`` of the palm as it really is; may be missing
    status : ``ScanStatus`` of the mapping node, which shows the sweeps; may be missing
    posterior : ``Posterior`` of the filter node, which shows the holds; may be missing
    """

    strain: str = "/strain"
    pose: str = "/palm_pose"
    truth: str = "/simulator/ground_truth"
    status: str = "/mapping/status"
    posterior: str = "/filter/posterior"


def read_bag(
    path: str | Path,
    scene: Scene,
    *,
    topics: BagTopics | None = None,
    frame: PalmFrame | None = None,
    max_gap_s: float = DEFAULT_MAX_GAP_S,
    by_status: bool = True,
    detector: SweepDetector | None = None,
    adapter: StrainAdapter | None = None,
) -> Recording:
    """Read a bag as a recording.

    Parameters
    ----------
    path : a directory or a file, SQLite or MCAP, compressed or not; damaged ones as far as they go
    scene : names the axes and phalanges that are read
    topics : by default those of this package's own nodes
    frame : the frames in which palm poses can be used; by default ``material``, and ``base_link`` as it is
    max_gap_s : poses further apart are not interpolated, s
    by_status : take the sweeps that the mapping node's status shows, if the bag has it; otherwise those
        between which the filter node's belief was spread, if the bag has its posterior. Without, the whole
        bag is one sweep
    detector : finds the sweeps in the motion instead
    adapter : makes strain of messages of other types, in place of those of ``topics.strain``

    Returns
    -------
    Recording
        Strain samples in sweeps that have a position; ``gaps`` counts those that have none. ``truth``
        is there when the bag has it, NaN where it has a gap.

    Raises
    ------
    ScanError
        The bag cannot be read, or lacks strain or poses.
    """
    topics = topics or BagTopics()
    frame = frame or PalmFrame(scene.axes, reference_frame="base_link")
    names = [name if name.startswith("/") else f"/{name}" for name in vars(topics).values()]
    strain_topic, pose_topic, truth_topic, status_topic, posterior_topic = names
    poses_by = PoseDecoder(frame)
    keep = (StrainDecoder(scene), poses_by, poses_by, Change.of_message, Travel.of_message)
    messages = read_messages(path, dict(zip(names, keep, strict=True)))
    notes = list(messages.notes)
    if adapter is not None:
        strains, strain_notes = read_adapted(path, adapter, scene)
        messages.by_topic[strain_topic] = [strains]
        notes += strain_notes
    for topic in (strain_topic, pose_topic):
        if not messages.by_topic.get(topic):
            raise ScanError(f"{path}: expected messages of {topic}, found {_found(messages)}")
    stamp_ns, strain, status = _strain_arrays(messages.by_topic[strain_topic], notes)

    def palm(topic: str) -> tuple[np.ndarray, np.ndarray]:
        pose_ns, poses = _pose_arrays(topic, messages.by_topic[topic], notes)
        return interpolate_poses(scene.axes, pose_ns, poses, stamp_ns, max_gap_s)

    position, found = palm(pose_topic)
    truth = palm(truth_topic)[0] if messages.by_topic.get(truth_topic) else None
    if detector is not None:
        spans = moving_spans(detector, stamp_ns[found], position[found])
    elif by_status and messages.by_topic.get(status_topic):
        spans = status_spans(messages.by_topic[status_topic])
    elif not by_status and messages.by_topic.get(posterior_topic):
        spans = held_spans(messages.by_topic[posterior_topic])
        early = int(np.sum(stamp_ns <= spans[0].after_ns))
        _note(notes, early, len(stamp_ns), f"strain vectors from before the first {posterior_topic}")
    else:
        spans = [WHOLE]
    whole = RecordedSweep(WHOLE.number, stamp_ns, position, strain, status, truth)
    sweeps = tuple(_sweep(whole, found, span) for span in spans)
    return Recording(
        str(path), scene.axis_names, scene.phalanx_names, sweeps, tuple(notes), scene.layout.counts
    )


def _sweep(whole: RecordedSweep, found: np.ndarray, span: Span) -> RecordedSweep:
    """The samples of a span that have a position; those that have none are its gaps."""
    inside = (whole.stamp_ns > span.after_ns) & (whole.stamp_ns <= span.until_ns)
    return whole.part(inside & found, span.number, gaps=int(np.sum(inside & ~found)))


def _strain_arrays(lots: Sequence[Strains], notes: list[str]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stamps (n,), strain (n, C) and status (n, F) of the scene's phalanges, as nodes take them."""
    stamp_ns, strain, status, fits = map(np.concatenate, zip(*lots, strict=True))
    _note(notes, int(np.sum(~fits)), len(fits), "strain vectors whose lengths do not fit")
    usable = _in_time(stamp_ns, np.flatnonzero(fits), "strain vectors", notes)
    return stamp_ns[usable], strain[usable], status[usable]


def _pose_arrays(topic: str, lots: Sequence[Poses], notes: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Stamps (m,) and positions (m, d) of the poses that can be used."""
    stamp_ns, position, fits = (np.concatenate(parts) for parts in list(zip(*lots, strict=True))[:3])
    reason = next((lot.refused for lot in lots if lot.refused), "")
    _note(notes, int(np.sum(~fits)), len(fits), f"poses of {topic}: {reason}")
    usable = _in_time(stamp_ns, np.flatnonzero(fits), f"poses of {topic}", notes)
    return stamp_ns[usable], position[usable]


def _in_time(stamp_ns: np.ndarray, rows: np.ndarray, what: str, notes: list[str]) -> np.ndarray:
    """Those of ``rows`` that came before any later one; those of zero are of no clock yet."""
    own = stamp_ns[rows]
    newest = np.maximum.accumulate(np.concatenate([[0], own]))
    in_time = own > newest[:-1]
    _note(notes, int(np.sum(~in_time)), len(rows), f"{what} whose stamps go back")
    return rows[in_time]


def _note(notes: list[str], count: int, total: int, what: str) -> None:
    if count:
        notes.append(f"left out {count} of {total} {what}")


def _found(messages: BagMessages) -> str:
    return ", ".join(f"{topic} ({kind})" for topic, kind in sorted(messages.topics.items())) or "no topics"


def read_adapted(path: str | Path, adapter: StrainAdapter, scene: Scene) -> tuple[Strains, list[str]]:
    """The strain vectors that an adapter makes of a bag's messages, and a note of what could not be used.

    Parameters
    ----------
    path : a bag as :func:`~.reader.read_messages` reads it, undamaged
    adapter : which messages are strain
    scene : names the phalanges that are wanted

    Raises
    ------
    ScanError
        The bag cannot be read, or lacks messages of the first phalanx.
    SceneError
        The adapter lacks a phalanx of the scene, or has it with other channels.
    """
    rows = scene.rows(adapter.phalanges)
    columns = scene.channels(adapter.phalanges, adapter.layout.counts)
    vectors, refused, reason = [], 0, ""
    topics = {f"/{topic.lstrip('/')}": topic for topic in adapter.topics}
    adapter.reset()
    try:
        with AnyReader([Path(path)], default_typestore=typestore()) as reader:
            connections = [
                each
                for each in reader.connections
                if each.topic in topics and adapter.topics[topics[each.topic]] == each.msgtype
            ]
            for connection, received_ns, raw in reader.messages(connections) if connections else ():
                try:
                    message = reader.deserialize(raw, connection.msgtype)
                    vector = adapter.feed(topics[connection.topic], message, received_ns)
                except MeasurementError as error:
                    refused, reason = refused + 1, reason or str(error)
                    continue
                if vector is not None:
                    vectors.append(vector)
    except Exception as error:  # rosbags raises whatever damaged bytes lead to
        text = " ".join(str(error).split()) or type(error).__name__
        raise ScanError(f"{path}: expected a bag that can be read, {text}") from None
    if not vectors:
        first = adapter.sources[0]
        raise ScanError(
            f"{path}: expected messages of {first.topic} ({first.kind}) for phalanx {first.phalanx}, found "
            f"{f'{refused} that cannot be used: {reason}' if refused else 'none'}"
        )
    stamp_ns, strain, status = map(np.array, zip(*vectors, strict=True))
    notes = [f"left out {refused} messages of other form: {reason}"] if refused else []
    fits = np.ones(len(vectors), dtype=bool)
    return Strains(stamp_ns, strain[:, columns], status[:, rows], fits), notes
