"""Reading a bag as a recording: strain and palm poses, paired by their stamps exactly as live."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tactile_localizer.errors import MeasurementError, ScanError, listed
from tactile_localizer.io.bags.conversions import CONVERTED, TF, TF_STATIC, adapted_strain, converted_strain
from tactile_localizer.io.bags.reader import BagMessages, Wanted, absolute, read_messages
from tactile_localizer.io.bags.sweeps import (
    TOPICS,
    WHOLE_BAG,
    Change,
    localized_changes,
    sweeps_at,
)
from tactile_localizer.io.recording import (
    RecordedSweep,
    Recording,
    cut,
    join,
    pose_notes,
    stamp_notes,
)
from tactile_localizer.io.strain_adapter import StrainAdapter
from tactile_localizer.scene import Scene
from tactile_localizer.streams.palm_frame import PalmFrame
from tactile_localizer.streams.runs import NANOSECONDS, STRAIN, Runs, runs_of
from tactile_localizer.streams.sweep_detector import SweepDetector
from tactile_localizer.streams.synchronization import DEFAULT_MAX_GAP_S, DEFAULT_PATIENCE_S, pair_recorded
from tactile_localizer.streams.transforms import combined

_MOST_DELAY_NS = NANOSECONDS // 10
"""Largest difference between the delays of strain and poses, ns (judgement): 5 mm at 50 mm/s."""


class _Arrived(NamedTuple):
    """A converted message, in the order of receipt.

    Parameters
    ----------
    value : what the message was converted to
    run : run of the strain in which it arrived, or :data:`LATE`
    strain_before : number of strain vectors before it
    received_ns : time of receipt, ns
    """

    value: Any
    run: int
    strain_before: int
    received_ns: int


def read_bag(
    path: str | Path,
    scene: Scene,
    *,
    topics: Mapping[str, str] | None = None,
    frame: PalmFrame | None = None,
    palm_frame: str = "",
    max_gap_s: float = DEFAULT_MAX_GAP_S,
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
    if palm_frame:
        del names["pose"]
        names |= {TF: TF, TF_STATIC: TF_STATIC}
    messages = read_messages(path, _wanted(names, strains), definitions, progress)
    found, notes = _by_name(messages, names, strains), messages.notes()
    if adapter is not None:
        notes += [*filter(None, map(adapter.mixed, adapter.topics)), *adapter.findings()]
    for name in ("strain", TF if palm_frame else "pose"):
        if not found[name]:
            raise _nothing_on(path, names[name], messages, notes)
    stamp_ns, strain, status = map(np.array, zip(*(each.value for each in found["strain"]), strict=True))
    run = np.array([each.run for each in found["strain"]])
    notes += stamp_notes(run, "strain vectors")
    topic = names.get("pose", TF)
    if palm_frame:
        found["pose"] = _from_tf(found, frame.reference_frame, palm_frame.lstrip("/"))
    pose_ns, poses, before = _positions(found["pose"], frame, topic, notes)
    receipt = "; stamp: receipt in the adapter takes the times of receipt" * (adapter is not None)
    clocks = stamp_ns, pose_ns, poses, max_gap_s, lambda ahead_s: receipt
    implausible = [*pose_notes(topic, scene.axes, *clocks)]
    notes += implausible or _delay_notes(found["strain"], found["pose"], topic)
    pair = partial(pair_recorded, scene.axes, stamp_ns)
    position, has_position, _ = pair(pose_ns, poses, max_gap_s, before)
    truth = None
    if found["truth"]:
        pose_ns, poses, before = _positions(found["truth"], frame, names["truth"], notes)
        truth, *_ = pair(pose_ns, poses, max_gap_s, before)
    samples = RecordedSweep(0, stamp_ns, position, strain, status, truth)
    number = np.ones(len(run), dtype=np.intp)
    for each in range(0 if detector else run.max() + 1):
        number[run == each] = sweeps_at(_changes(found, each, by_status), stamp_ns[run == each])
    sweeps, outside = cut(samples, run, number, has_position, detector)
    lost = sum(count for count, _ in messages.invalid.values())
    return join([Recording(str(path), tuple(sweeps), (*notes, *outside), lost)])


def _wanted(names: Mapping[str, str], strains: Mapping[str, Wanted]) -> dict[str, Wanted]:
    """What to read of each topic, of which ``strains`` are those with strain."""
    others = {topic: CONVERTED[name] for name, topic in names.items() if name != "strain"}
    if len(others) < len(names) - 1 or others.keys() & strains.keys():
        used = ", ".join([*names.values(), *list(strains)[1:]])
        raise ScanError(f"topics: expected different ones, got {used}")
    return {**others, **strains}


def _by_name(
    messages: BagMessages, names: Mapping[str, str], strains: Mapping[str, Wanted]
) -> dict[str, list[_Arrived]]:
    """The messages by the names of their topics, in the order of receipt."""
    named = {topic: name for name, topic in names.items()} | dict.fromkeys(strains, "strain")
    found: dict[str, list[_Arrived]] = defaultdict(list)
    strain, received = Runs(), messages.received
    leads_ns = [value.stamp_ns - received_ns for topic, received_ns, value in received if topic in strains]
    ahead_ns = max(leads_ns, default=0)
    for topic, received_ns, value in received:
        name, before = named[topic], len(found["strain"])
        run = strain.number[STRAIN] if name != "strain" else strain.add(STRAIN, value.stamp_ns)
        if name == "active":  # which has no stamp: the present in the clock of the strain, as it is live
            present_ns = strain.newest_ns[STRAIN] or 0
            if abs(ahead_ns) <= DEFAULT_PATIENCE_S * NANOSECONDS:
                present_ns = max(present_ns, received_ns + max(ahead_ns, 0))
            value = Change(present_ns, value)
        found[name].append(_Arrived(value, run, before, received_ns))
    return found


def _nothing_on(path: str | Path, topic: str, messages: BagMessages, notes: list[str]) -> ScanError:
    there = ", ".join(f"{topic} ({kind})" for topic, kind in sorted(messages.topics.items()))
    if topic in messages.topics:
        found = "; ".join(notes) or "it has none"
        return ScanError(f"{path}: expected messages of {topic} that can be used, found none: {found}")
    reasons = "; ".join([there or "no topics", *notes])
    advice = "; --palm-frame FRAME looks the pose up in tf" if TF in messages.topics and topic != TF else ""
    return ScanError(f"{path}: expected messages of {topic}, found {reasons}{advice}")


def _delay_notes(strain: Sequence[_Arrived], poses: Sequence[_Arrived], topic: str) -> Iterator[str]:
    """A finding about poses on ``topic`` whose stamps are far from those of the strain received with them."""
    strain_ns = np.array([each.value.stamp_ns - each.received_ns for each in strain])
    pose_ns = np.array([each.value[1] - each.received_ns for each in poses])
    before = np.maximum([each.strain_before - 1 for each in poses], 0)
    ahead_ns = float(np.median(pose_ns - strain_ns[before]))
    if abs(ahead_ns) > _MOST_DELAY_NS:
        way = "ahead of" if ahead_ns > 0.0 else "behind"
        text = f"stamps are {abs(ahead_ns) / NANOSECONDS:.2g} s {way} the strain received with them"
        yield f"{topic}: {text}: another clock, or the time of sending?"


def _changes(found: Mapping[str, list[_Arrived]], run: int, by_status: bool) -> Sequence[Change]:
    """Sweeps of a run of the strain, as the nodes report them in the messages ``found`` by name."""

    def until(name: str) -> list[Any]:
        """Messages until the end of the run; those of the time before it have stamps before all."""
        until_now = [each for each in found[name] if each.run <= run]
        stamp_ns = [each.value.stamp_ns if each.run == run else -1 for each in until_now]
        at_ns = np.minimum.accumulate(stamp_ns[::-1])[::-1].tolist()
        return [each.value._replace(stamp_ns=at) for each, at in zip(until_now, at_ns, strict=True)]

    if by_status:
        return until("status") if found["status"] else WHOLE_BAG
    return localized_changes(until("active"), until("posterior"))


def _from_tf(found: Mapping[str, list[_Arrived]], target: str, source: str) -> list[_Arrived]:
    """Poses of one frame in another, as the nodes take them from tf."""
    static = [each for message in found[TF_STATIC] for each in message.value]
    rows, stamp_ns, poses = combined(static, [each.value for each in found[TF]], target, source)
    if not len(rows):
        transforms = chain(static, *(message.value for message in found[TF]))
        names = sorted({name for each in transforms for name in (each.parent, each.child)})
        frames = f"the frames {listed(names)}, which do not connect them"
        raise ScanError(f"{TF}: expected moving transforms from {source} to {target}, found {frames}")
    from scipy.spatial.transform import Rotation

    numbers = np.hstack([poses[:, :3, 3], Rotation.from_matrix(poses[:, :3, :3]).as_quat()])
    values = zip(stamp_ns.tolist(), map(tuple, numbers.tolist()), strict=True)
    return [
        found[TF][row]._replace(value=(target, *value))
        for row, value in zip(rows.tolist(), values, strict=True)
    ]


def _positions(
    poses: Sequence[_Arrived], frame: PalmFrame, topic: str, notes: list[str]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Poses in a known frame: stamps (m,), ns; finite positions (m, d); strain vectors before each (m,)."""
    names, stamp_ns, numbers = map(np.array, zip(*(each.value for each in poses), strict=True))
    before = np.array([each.strain_before for each in poses])
    position = np.full((len(names), frame.dimension), np.nan)
    reason = "not finite, or of impossible size"
    for name in np.unique(names).tolist():
        rows = names == name
        try:
            position[rows] = frame.positions(name, numbers[rows, :3], numbers[rows, 3:])
        except MeasurementError as error:
            reason = f"{error}; --material-frame or --reference-frame names another"
    valid = np.isfinite(position).all(axis=1)
    if not valid.all():
        notes.append(f"skipped {np.sum(~valid)} of {len(valid)} poses of {topic}: {reason}")
    notes += stamp_notes(runs_of(stamp_ns[valid]), f"poses of {topic}")
    return stamp_ns[valid], position[valid], before[valid]
