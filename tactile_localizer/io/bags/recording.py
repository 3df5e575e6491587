"""Reading a bag as a recording: strain and palm poses, paired by their stamps exactly as live."""

from __future__ import annotations

from collections.abc import Sequence
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
    WHOLE_BAG,
    Span,
    StatusChange,
    Travel,
    localization_spans,
    moving_spans,
    status_spans,
)
from tactile_localizer.io.bags.topics import BagTopics
from tactile_localizer.io.recording import RecordedSweep, Recording
from tactile_localizer.io.strain_adapter import StrainAdapter
from tactile_localizer.scene import Scene


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
    path : directory or file, SQLite or MCAP, compressed or not; a damaged bag is read up to the damage
    scene : axes and phalanges to read
    topics : default: the topics of this package's nodes
    frame : frames in which palm poses are accepted; default: ``material``, and ``base_link`` untransformed
    max_gap_s : longest gap between poses that is interpolated, s
    by_status : if true, take the sweeps from the mapping node's status; if false, start a sweep at each
        global localization in the filter node's posterior. A bag without that topic is one sweep
    detector : detects the sweeps in the motion instead
    adapter : converts messages of other types to strain, in place of ``topics.strain``

    Returns
    -------
    Recording
        Strain samples with a position, by sweep; ``gaps`` counts the samples without one. ``truth`` is
        ``None`` if the bag has no such topic, and NaN in its gaps.

    Raises
    ------
    ScanError
        The bag cannot be read, or has no strain or no poses.
    """
    topics = topics or BagTopics()
    frame = frame or PalmFrame(scene.axes, reference_frame="base_link")
    names = [name if name.startswith("/") else f"/{name}" for name in vars(topics).values()]
    strain_topic, pose_topic, truth_topic, status_topic, posterior_topic = names
    pose_decoder = PoseDecoder(frame)
    converters = (
        StrainDecoder(scene),
        pose_decoder,
        pose_decoder,
        StatusChange.of_message,
        Travel.of_message,
    )
    messages = read_messages(path, dict(zip(names, converters, strict=True)))
    notes = list(messages.notes)
    if adapter is not None:
        strains, strain_notes = read_adapted(path, adapter, scene)
        messages.by_topic[strain_topic] = [strains]
        notes += strain_notes
    for topic in (strain_topic, pose_topic):
        if not messages.by_topic.get(topic):
            raise ScanError(f"{path}: expected messages of {topic}, found {_found(messages)}")
    stamp_ns, strain, status = _strain_arrays(messages.by_topic[strain_topic], notes)

    def palm_positions(topic: str) -> tuple[np.ndarray, np.ndarray]:
        pose_ns, poses = _pose_arrays(topic, messages.by_topic[topic], notes)
        return interpolate_poses(scene.axes, pose_ns, poses, stamp_ns, max_gap_s)

    position, found = palm_positions(pose_topic)
    truth = palm_positions(truth_topic)[0] if messages.by_topic.get(truth_topic) else None
    if detector is not None:
        spans = moving_spans(detector, stamp_ns[found], position[found])
    elif by_status and messages.by_topic.get(status_topic):
        spans = status_spans(messages.by_topic[status_topic])
    elif not by_status and messages.by_topic.get(posterior_topic):
        spans = localization_spans(messages.by_topic[posterior_topic])
        early = int(np.sum(stamp_ns <= spans[0].after_ns))
        _note(notes, early, len(stamp_ns), f"strain vectors from before the first {posterior_topic}")
    else:
        spans = [WHOLE_BAG]
    samples = RecordedSweep(WHOLE_BAG.number, stamp_ns, position, strain, status, truth)
    sweeps = tuple(_sweep(samples, found, span) for span in spans)
    return Recording(
        str(path), scene.axis_names, scene.phalanx_names, sweeps, tuple(notes), scene.layout.counts
    )


def _sweep(samples: RecordedSweep, found: np.ndarray, span: Span) -> RecordedSweep:
    """The samples of a span that have a position; samples without one are counted as gaps."""
    inside = (samples.stamp_ns > span.after_ns) & (samples.stamp_ns <= span.until_ns)
    return samples.part(inside & found, span.number, gaps=int(np.sum(inside & ~found)))


def _strain_arrays(blocks: Sequence[Strains], notes: list[str]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stamps (n,), strain (n, C) and status (n, F) of the scene's phalanges, in rising order of stamps."""
    stamp_ns, strain, status, valid = map(np.concatenate, zip(*blocks, strict=True))
    _note(notes, int(np.sum(~valid)), len(valid), "strain vectors with contradictory lengths")
    usable = _in_order(stamp_ns, np.flatnonzero(valid), "strain vectors", notes)
    return stamp_ns[usable], strain[usable], status[usable]


def _pose_arrays(topic: str, blocks: Sequence[Poses], notes: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Stamps (m,) and positions (m, d) of the valid poses, in rising order of stamps."""
    stamp_ns, position, valid = (np.concatenate(parts) for parts in list(zip(*blocks, strict=True))[:3])
    reason = next((block.reason for block in blocks if block.reason), "")
    _note(notes, int(np.sum(~valid)), len(valid), f"poses of {topic}: {reason}")
    usable = _in_order(stamp_ns, np.flatnonzero(valid), f"poses of {topic}", notes)
    return stamp_ns[usable], position[usable]


def _in_order(stamp_ns: np.ndarray, rows: np.ndarray, what: str, notes: list[str]) -> np.ndarray:
    """Those of ``rows`` whose stamp is later than all before it; a stamp of 0 means no time yet."""
    candidates = stamp_ns[rows]
    newest = np.maximum.accumulate(np.concatenate([[0], candidates]))
    in_order = candidates > newest[:-1]
    _note(notes, int(np.sum(~in_order)), len(rows), f"{what} whose stamps go back")
    return rows[in_order]


def _note(notes: list[str], count: int, total: int, what: str) -> None:
    if count:
        notes.append(f"skipped {count} of {total} {what}")


def _found(messages: BagMessages) -> str:
    return ", ".join(f"{topic} ({kind})" for topic, kind in sorted(messages.topics.items())) or "no topics"


def read_adapted(path: str | Path, adapter: StrainAdapter, scene: Scene) -> tuple[Strains, list[str]]:
    """Strain vectors that an adapter makes of a bag's messages, and notes on messages that it rejects.

    Parameters
    ----------
    path : an undamaged bag, as :func:`~.reader.read_messages` reads it
    adapter : maps messages to strain
    scene : phalanges to read

    Raises
    ------
    ScanError
        The bag cannot be read, or has no messages of the first phalanx.
    SceneError
        The adapter lacks a phalanx of the scene, or gives it a different number of channels.
    """
    rows = scene.rows(adapter.phalanges)
    columns = scene.channels(adapter.phalanges, adapter.layout.counts)
    vectors, rejected, reason = [], 0, ""
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
                    rejected, reason = rejected + 1, reason or str(error)
                    continue
                if vector is not None:
                    vectors.append(vector)
    except Exception as error:  # rosbags raises many types of exceptions on damaged bytes
        text = " ".join(str(error).split()) or type(error).__name__
        raise ScanError(f"{path}: expected a readable bag, {text}") from None
    if not vectors:
        first = adapter.sources[0]
        raise ScanError(
            f"{path}: expected messages of {first.topic} ({first.kind}) for phalanx {first.phalanx}, found "
            f"{f'{rejected} invalid ones: {reason}' if rejected else 'none'}"
        )
    stamp_ns, strain, status = map(np.array, zip(*vectors, strict=True))
    notes = [f"skipped {rejected} invalid messages: {reason}"] if rejected else []
    valid = np.ones(len(vectors), dtype=bool)
    return Strains(stamp_ns, strain[:, columns], status[:, rows], valid), notes
