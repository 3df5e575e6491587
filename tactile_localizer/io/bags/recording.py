"""Reading a bag as a recording: the session that was recorded, message by message."""

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path

import numpy as np

from tactile_localizer.errors import MeasurementError, ScanError, listed
from tactile_localizer.io.bags.conversions import (
    CONVERTED,
    TF,
    TF_STATIC,
    adapted_strain,
    converted_poses,
    converted_strain,
)
from tactile_localizer.io.bags.reader import Received, Wanted, absolute, read_messages
from tactile_localizer.io.bags.sweeps import TOPICS, WHOLE_BAG, Mark, Reports, Travel, localized_sweeps
from tactile_localizer.io.recording import (
    RecordedSweep,
    Recording,
    cut,
    detection_notes,
    join,
    pose_notes,
    stamp_notes,
)
from tactile_localizer.io.strain_adapter import StrainAdapter, StrainVector
from tactile_localizer.scene import Scene
from tactile_localizer.streams.arrivals import Arrivals
from tactile_localizer.streams.palm_frame import PalmFrame
from tactile_localizer.streams.runs import NANOSECONDS, POSES, STRAIN
from tactile_localizer.streams.session import DEFAULT_PATIENCE_S, Pair, Session
from tactile_localizer.streams.sweep_detector import SweepDetector
from tactile_localizer.streams.synchronization import DEFAULT_MAX_GAP_S
from tactile_localizer.streams.transforms import combined


def read_bag(
    path: str | Path,
    scene: Scene,
    *,
    topics: Mapping[str, str] | None = None,
    frame: PalmFrame | None = None,
    palm_frame: str = "",
    max_gap_s: float = DEFAULT_MAX_GAP_S,
    delay_s: float = 0.0,
    by_status: bool = True,
    detector: SweepDetector | None = None,
    adapter: StrainAdapter | None = None,
    definitions: str | Path | None = None,
    progress: Callable[[str, float], None] = lambda text, fraction: None,
) -> Recording:
    """Read a bag as a recording.

    Parameters
    ----------
    path : directory or file, SQLite or MCAP
    scene : axes and phalanges to read
    topics : those with other names than in :data:`~tactile_localizer.io.bags.sweeps.TOPICS`
    frame : frames in which palm poses are accepted; default: ``material``, and ``base_link`` untransformed
    palm_frame : frame of the palm, whose pose is looked up in tf, in place of the topic ``pose``
    max_gap_s : longest gap between poses that is interpolated, s
    delay_s : time by which the strain is late against the poses, s
    by_status : if true, take the sweeps from the mapping node's status; if false, those of the localization:
        while the topic ``active`` is true, or else from each global localization in the filter node's
        posterior. A bag without these topics is one sweep
    detector : detects the sweeps in the motion instead
    adapter : converts messages of other types to strain, in place of the topic ``strain``
    definitions : folder of ``.msg`` files, for message types that neither the bag nor ROS 2 defines
    progress : called with a description of the work and the completed fraction

    Returns
    -------
    Recording
        Strain samples with a position, by sweep; where the stamps jump back, another sweep begins. ``gaps``
        counts the samples without a position. ``truth`` is ``None`` if the bag has no such topic, and NaN in
        its gaps. The notes count unreadable messages.

    Raises
    ------
    ScanError
        The bag cannot be read, or has no strain or no poses.
    SceneError
        The messages or the adapter lack a phalanx of the scene, or have other channels for it.
    """
    frame = frame or PalmFrame(scene.axes, reference_frame="base_link")
    default = {name: topic for name, (topic, _) in TOPICS.items()}
    names = {name: absolute(topic) for name, topic in {**default, **(topics or {})}.items()}
    strains = converted_strain(scene, names["strain"]) if adapter is None else adapted_strain(adapter, scene)
    names["strain"] = next(iter(strains))
    converted = {**CONVERTED, **dict.fromkeys(("pose", "truth"), converted_poses(frame))}
    if palm_frame:
        del names["pose"]
        names |= {TF: TF, TF_STATIC: TF_STATIC}
    messages = read_messages(path, _wanted(names, strains, converted), definitions, progress)
    pose = names.get("pose", TF)
    named = {topic: name for name, topic in names.items()} | dict.fromkeys(strains, "strain") | {pose: "pose"}
    notes = messages.notes()
    if adapter is not None:
        notes += [*filter(None, map(adapter.mixed, adapter.topics)), *adapter.findings()]
    received = [Received(named[topic], received_ns, value) for topic, received_ns, value in messages.received]
    counts = Counter(each.topic for each in received)
    if not (counts["strain"] and counts["pose"]):
        raise _nothing_on(path, pose if counts["strain"] else names["strain"], messages.topics, notes)
    if palm_frame:
        received = _with_poses_of_tf(received, frame, palm_frame.lstrip("/"))
    session_of = partial(_session, received, scene, max_gap_s, delay_s, by_status)
    session = session_of(detector)
    counts = Counter(each.topic for each in received)
    for kind, what in ((STRAIN, "strain vectors"), (POSES, f"poses of {pose}")):
        runs, count = session.runs, counts["strain" if kind == STRAIN else "pose"]
        notes += stamp_notes(what, count, runs.late[kind], runs.jumps[kind])
    receipt = "; stamp: receipt in the adapter takes the times of receipt" * (adapter is not None)
    notes += pose_notes(pose, session.seen(), lambda ahead_s: receipt)
    pairs = session.finish()
    samples = _samples(pairs, scene)
    if counts["truth"]:
        true = session_of(poses="truth")
        late, jumps = true.runs.late[POSES], true.runs.jumps[POSES]
        notes += stamp_notes(f"poses of {names['truth']}", counts["truth"], late, jumps)
        samples = replace(samples, truth=_samples(true.finish(), scene).position)
    run, sweep = np.array([(each.run, each.sweep) for each in pairs]).T
    notes += detection_notes(sweep) if detector else []
    lost = sum(count for topic, (count, _) in messages.invalid.items() if topic in strains)
    sweeps = cut(samples, run, sweep)
    return join([Recording(str(path), tuple(sweeps), tuple(notes), lost)])


def _wanted(
    names: Mapping[str, str], strains: Mapping[str, Wanted], converted: Mapping[str, Wanted]
) -> dict[str, Wanted]:
    """What to read of each topic, of which ``strains`` are those with strain."""
    others = {topic: converted[name] for name, topic in names.items() if name != "strain"}
    if len(others) < len(names) - 1 or others.keys() & strains.keys():
        used = ", ".join([*names.values(), *list(strains)[1:]])
        raise ScanError(f"topics: expected different ones, got {used}")
    return {**others, **strains}


def _nothing_on(path: str | Path, topic: str, topics: Mapping[str, str], notes: list[str]) -> ScanError:
    there = ", ".join(f"{topic} ({kind})" for topic, kind in sorted(topics.items()))
    if topic in topics:
        found = "; ".join(notes) or "it has none"
        return ScanError(f"{path}: expected messages of {topic} that can be used, found none: {found}")
    reasons = "; ".join([there or "no topics", *notes])
    advice = "; --palm-frame FRAME looks the pose up in tf" if TF in topics and topic != TF else ""
    return ScanError(f"{path}: expected messages of {topic}, found {reasons}{advice}")


def _session(
    received: Sequence[Received],
    scene: Scene,
    max_gap_s: float,
    delay_s: float,
    by_status: bool,
    detector: SweepDetector | None = None,
    poses: str = "pose",
) -> Session[StrainVector]:
    """The session in which messages were received, each with its topic's name in :data:`TOPICS`."""
    session: Session[StrainVector] = Session(
        scene.axes,
        max_gap_s=max_gap_s,
        patience_s=math.inf,
        delay_s=delay_s,
        detector=detector,
        arrivals=Arrivals(),
    )
    flags, travels = list[Mark](), list[Travel]()
    statuses, posteriors = Reports(), Reports()
    ahead_ns = max(value.stamp_ns - received_ns for name, received_ns, value in received if name == "strain")
    ahead_ns -= session.delay_ns
    is_of_receiver = abs(ahead_ns) <= DEFAULT_PATIENCE_S * NANOSECONDS
    for name, received_ns, value in received:
        if name == "strain":
            session.add_strain(value.stamp_ns, value, received_ns)
        elif name == poses:
            stamp_ns, position = value
            session.add_pose(stamp_ns, position, received_ns)
        elif name == "status" and by_status:
            session.mark(statuses.run_of(value[0], session), *value)
        elif name == "active":  # which has no stamp: the present in the clock of the strain, as it is live
            present_ns = received_ns + max(ahead_ns, 0) if is_of_receiver else 0
            flags.append(Mark(session.run, max(session.newest_ns or 0, present_ns), value))
        elif name == "posterior":
            travels.append(Travel(posteriors.run_of(value[0], session), *value))
    reported = [] if by_status else localized_sweeps(flags, travels)
    for mark in reported or [WHOLE_BAG] * (not session.has_marks):
        session.mark(*mark)
    return session


def _samples(pairs: Sequence[Pair[StrainVector]], scene: Scene) -> RecordedSweep:
    """Samples of pairs as of one sweep; their positions are NaN where there is none."""
    unknown = np.full(scene.dimension, math.nan)
    position = np.array([unknown if each.position is None else each.position for each in pairs])
    stamp_ns = np.array([each.stamp_ns for each in pairs])
    _, strain, status = map(np.array, zip(*(each.measurement for each in pairs), strict=True))
    return RecordedSweep(0, stamp_ns, position, strain, status)


def _with_poses_of_tf(received: Sequence[Received], frame: PalmFrame, source: str) -> list[Received]:
    """What was received, with the poses of a frame as the nodes take them from tf in place of ``/tf``."""
    static = [each for name, _, value in received if name == TF_STATIC for each in value]
    moving = [each for each in received if each.topic == "pose"]
    target = frame.reference_frame
    rows, stamp_ns, poses = combined(static, [each.value for each in moving], target, source)
    if not len(rows):
        transforms = chain(static, *(each.value for each in moving))
        names = sorted({name for each in transforms for name in (each.parent, each.child)})
        frames = f"the frames {listed(names)}, which do not connect them"
        raise ScanError(f"{TF}: expected moving transforms from {source} to {target}, found {frames}")
    from scipy.spatial.transform import Rotation

    numbers = np.hstack([poses[:, :3, 3], Rotation.from_matrix(poses[:, :3, :3]).as_quat()]).tolist()
    found = {}
    for row, stamp, pose in zip(rows.tolist(), stamp_ns.tolist(), numbers, strict=True):
        with suppress(MeasurementError):  # of impossible size
            found[id(moving[row])] = stamp, frame.position(target, pose[:3], pose[3:])
    return [
        each._replace(value=found.get(id(each), each.value))
        for each in received
        if each.topic != "pose" or id(each) in found
    ]
