"""Strain vectors and palm poses that a node receives, paired by their stamps."""

import time
from collections import Counter, deque
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped
from rclpy.qos import QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription

from tactile_localizer.errors import ParameterError, TactileLocalizerError, counted
from tactile_localizer.io.scans.recorder import StrainSample
from tactile_localizer.io.strain_vectors import StrainReader
from tactile_localizer.msg import StrainVectors
from tactile_localizer.ros.base.managed_node import ManagedNode
from tactile_localizer.ros.base.parameters import Parameter
from tactile_localizer.ros.diagnostics.status import LargestRecent, publisher_names
from tactile_localizer.ros.subscriptions.tf_poses import TfPoses
from tactile_localizer.scene import Axis, Scene
from tactile_localizer.streams.alternation import alternates
from tactile_localizer.streams.arrivals import Arrivals
from tactile_localizer.streams.delay import MOST_DELAY_S
from tactile_localizer.streams.findings import CLOCKS, findings
from tactile_localizer.streams.palm_frame import PalmFrame
from tactile_localizer.streams.runs import NANOSECONDS, stamp_of
from tactile_localizer.streams.session import DEFAULT_PATIENCE_S, Pair, Session
from tactile_localizer.streams.sources import describe_sources
from tactile_localizer.streams.sweep_detector import SweepDetector
from tactile_localizer.streams.synchronization import DEFAULT_MAX_GAP_S

_Pairs = list[Pair[StrainSample]]

_CLOCKS_S, _BEHIND_S = 10.0, 2.0
"""Times of which the smallest delay is that of the clocks, and the largest that of this node, s."""
_POSES_PER_STRAIN = 10
"""Poses that wait for each strain vector that does: arms publish at up to 1 kHz, and no pose costs much."""
_LONG_S = 0.1
"""Time that a message waits for this node from which it is behind, s (judgement)."""
_POSES, _LATEST = 2000, 4
"""Numbers of poses whose motion is judged, and of those whose distance is."""
_LEADS_S = 2.0
"""Time of which poses are judged by their clock, s: one that is set again is reported after half of it."""
_STRAINS = 200
"""Number of strain vectors that are compared with each other."""

INPUTS = ("strain", "palm_pose")
"""Names of the inputs."""

SYNCHRONIZATION = (
    Parameter(
        "max_gap_s", DEFAULT_MAX_GAP_S, "Longest interval between poses that is interpolated", "s", 0.0, 10.0
    ),
    Parameter(
        "patience_s",
        DEFAULT_PATIENCE_S,
        "Time, measured in stamps, that a strain vector waits for a late pose",
        "s",
        0.0,
        60.0,
    ),
    Parameter(
        "strain_delay_s",
        0.0,
        "Time by which strain is late against the poses, subtracted from its stamps; that of the scan",
        "s",
        -MOST_DELAY_S,
        MOST_DELAY_S,
    ),
    Parameter(
        "queue_depth",
        100,
        "Depth of the queue of strain vectors; that of the poses is ten times as deep",
        "",
        1,
        100_000,
    ),
)
"""Queues, and synchronization of poses with strain vectors."""

FRAMES = (
    Parameter(
        "pose_source",
        "topic",
        "Source of palm poses: topic palm_pose, or tf",
        choices=("topic", "tf"),
    ),
    Parameter("palm_frame", "palm", "Frame of the palm, looked up in reference_frame if pose_source is tf"),
    Parameter("material_frame", "material", "Frame of the material; palm poses in it are used unchanged"),
    Parameter(
        "reference_frame",
        "base_link",
        "Other accepted frame of palm poses, transformed by material_pose; empty for none",
    ),
    Parameter(
        "material_pose",
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        "Pose of material_frame in reference_frame: x, y, z, roll, pitch, yaw",
        "m, rad",
    ),
)
"""Source and frames of the poses."""


class TactileInputs:
    """Receives strain and palm poses, and passes on the pairs that they make; :meth:`start` it first.

    Parameters
    ----------
    node : its parameters include :data:`SYNCHRONIZATION` and :data:`FRAMES`
    on_pairs : called with the pairs that a message completes, in the order of their stamps

    Attributes
    ----------
    session : pairs the strain vectors with poses
    received, invalid : numbers of messages and of invalid ones, by topic: ``strain`` and ``palm_pose``
    problems : why the last message of a topic was invalid; without the topics whose last one was valid

    Raises
    ------
    ParameterError
        ``material_pose`` is not six finite numbers. With ``pose_source`` tf: tf2_ros is not installed, or
        ``reference_frame`` is empty.
    """

    def __init__(self, node: ManagedNode, on_pairs: Callable[[_Pairs], None]) -> None:
        self._node, self._on_pairs = node, on_pairs
        self._tf: TfPoses | None = None
        if node.parameters["pose_source"] == "tf":
            frames = node.parameters["reference_frame"], node.parameters["palm_frame"]
            if not frames[0]:
                raise ParameterError("reference_frame: expected the target of the lookup in tf, got none")
            self._tf = TfPoses(*frames, self._add_pose)
        self._frame = self._palm_frame(())  # rejects an invalid pose before a scan is loaded

    def start(self, scene: Scene, detector: SweepDetector | None = None) -> None:
        """Begin anew with the axes and phalanges of a scene: the next messages do not continue the last.

        ``detector`` detects sweeps in the motion.
        """
        parameters = self._node.parameters
        self._axes, self._frame = scene.axes, self._palm_frame(scene.axes)
        self._reader = StrainReader(scene)
        self.session: Session[StrainSample] = Session(
            scene.axes,
            max_gap_s=parameters["max_gap_s"],
            patience_s=parameters["patience_s"],
            delay_s=parameters["strain_delay_s"],
            detector=detector,
            arrivals=Arrivals(_POSES, _LEADS_S),
        )
        self.received: Counter[str] = Counter()
        self.invalid: Counter[str] = Counter()
        self._ahead_of_node_ns = LargestRecent(_CLOCKS_S)  # stamps of the strain on arrival
        self._ahead_of_sender_ns = LargestRecent(_CLOCKS_S)  # times of sending on arrival
        self._waits_ns = LargestRecent(_BEHIND_S)
        self._frames: dict[str, set[str]] = {topic: set() for topic in INPUTS}
        self._recent: deque[np.ndarray] = deque(maxlen=_STRAINS)
        self.problems: dict[str, str] = {}

    def subscribe(self) -> None:
        """Subscribe to strain and poses, best effort: reliable publishers match too."""
        depth = self._node.parameters["queue_depth"]

        overridden = QoSOverridingOptions((QoSPolicyKind.RELIABILITY,))
        strain = QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)
        poses = QoSProfile(depth=_POSES_PER_STRAIN * depth, reliability=ReliabilityPolicy.BEST_EFFORT)
        subscribe = partial(self._node.create_subscription, qos_overriding_options=overridden)
        self._strain = subscribe(StrainVectors, "strain", self._on_strain, strain)
        if self._tf is None:
            self._poses = [subscribe(PoseStamped, "palm_pose", self._on_pose, poses)]
        else:
            self._poses = self._tf.subscribe(self._node)

    def take_waiting(self) -> None:
        """Process the strain that has arrived, and the poses that it waits for."""
        most = self._node.parameters["queue_depth"]  # messages may arrive faster than they are processed
        for _ in range(most):
            if not self._take_next(self._strain):
                break
        self._take_poses()

    def present_ns(self) -> int:
        """Time in the clock of the strain, ns; 0 before any strain.

        It is the time of the node, if strain arrives within ``patience_s`` of its stamps; otherwise, as where
        a sensor counts from its own start, it is the newest stamp that has arrived.
        """
        ahead_ns = self._ahead_of_node_ns.largest
        if abs(ahead_ns) > self._node.parameters["patience_s"] * NANOSECONDS:
            self.take_waiting()
            return self.newest_ns
        return max(self.newest_ns, self._node.now_ns + max(round(ahead_ns), 0))

    @property
    def lost(self) -> int:
        """Number of strain vectors lost in transport."""
        return self._reader.lost

    @property
    def newest_ns(self) -> int:
        """Stamp of the newest strain vector, ns; 0 before the first."""
        return self.session.newest_ns or 0

    def finding(self, of: str = "", moves: bool = False) -> str:
        """What is implausible about the clocks or the motion of the poses, in one line; empty if nothing is.

        Parameters
        ----------
        of : :data:`.CLOCKS` or :data:`.MOTION`; empty: either
        moves : whether it is implausible that the palm is at rest all the time
        """
        seen = self.session.seen("max_gap_s")
        return next((f"palm_pose: {each.text}" for each in findings(seen, of=of, live=True, moves=moves)), "")

    def mixed(self) -> str:
        """Two sources of one topic since the last call, in one line; empty without."""
        found, frames = list[str](), self._frames
        self._frames = {topic: set() for topic in INPUTS}
        for topic, seen in frames.items():
            is_tf = topic == "palm_pose" and self._tf is not None
            publishers = [] if is_tf else self._publishers(topic)
            found.append(describe_sources(topic, publisher_names(publishers), sorted(seen - {""})))
        strain = list(self._recent)
        if not any(found) and len({len(each) for each in strain}) == 1 and alternates(np.array(strain)):
            found.append("strain alternates from sample to sample: two sources")
        return "; ".join(filter(None, found))

    @property
    def behind(self) -> str:
        """By how much this node is behind the messages that it has received; empty if it is not."""
        wait_s = self._waits_ns.largest / NANOSECONDS
        return f"this node is behind by {wait_s:.1f} s" if wait_s > _LONG_S else ""

    def absence(self, topic: str) -> str:
        """Where no message of a topic arrives: its name in the graph, and its publishers."""
        of_tf = self._tf if topic == "palm_pose" else None
        subscription = self._subscription(topic)
        name = self._node.resolve_topic_name(subscription.topic)
        publishers = self._publishers(topic)
        described, kind = [counted(len(publishers), "publisher")], subscription.msg_type
        own = f"{kind.__module__.partition('.')[0]}/msg/{kind.__name__}"
        described += [f"of {other}" for other in sorted({each.topic_type for each in publishers} - {own})]
        reliable = [each.qos_profile.reliability == ReliabilityPolicy.RELIABLE for each in publishers]
        if subscription.qos_profile.reliability == ReliabilityPolicy.RELIABLE and not all(reliable):
            described.append("best effort, expected reliable")
        text = f"no {topic} on {name} ({', '.join(described)})"
        return f"{text}: {of_tf.problem}" if of_tf and of_tf.problem else text

    def sparsity(self, age_s: float) -> str:
        """The finding about poses that are too far apart to be interpolated; empty if they are not.

        ``age_s`` is the time since the newest pose: poses that have stopped are absent.
        """
        seen = self.session.seen("max_gap_s", latest=_LATEST)
        spacing = [each for each in findings(seen, of=CLOCKS, live=True) if each.name == "spacing"]
        return next((f"palm_pose: {f.text}" for f in spacing if age_s < 2 * f.value * seen.max_gap_s), "")

    def position(self, message: PoseStamped) -> np.ndarray:
        """The palm's position on the scene's axes, (d,), m (yaw: rad).

        Raises
        ------
        MeasurementError
            The pose is in an unknown frame, or not finite.
        """
        point, turn = message.pose.position, message.pose.orientation
        return self._frame.position(
            message.header.frame_id, (point.x, point.y, point.z), (turn.x, turn.y, turn.z, turn.w)
        )

    def reject(self, topic: str, error: TactileLocalizerError) -> None:
        """Count and log an invalid message."""
        self.invalid[topic] += 1
        self.problems[topic] = f"{topic}: {error}"
        self._node.get_logger().error(self.problems[topic], throttle_duration_sec=1.0)

    def _subscription(self, topic: str) -> Subscription:
        return self._strain if topic == "strain" else self._poses[0]

    def _publishers(self, topic: str) -> list[Any]:
        name = self._node.resolve_topic_name(self._subscription(topic).topic)
        return list(self._node.get_publishers_info_by_topic(name))

    def _palm_frame(self, axes: tuple[Axis, ...]) -> PalmFrame:
        parameters = self._node.parameters
        return PalmFrame(
            axes, parameters["material_frame"], parameters["reference_frame"], parameters["material_pose"]
        )

    def _take_next(self, subscription: Subscription) -> bool:
        """Process the next message of a subscription ahead of the executor; returns whether there was one."""
        with subscription.handle:
            taken = subscription.handle.take_message(subscription.msg_type, False)
        if taken is not None:
            subscription.callback(*taken)
        return taken is not None

    def _take_poses(self) -> None:
        """Process poses while strain waits for them and there are any."""
        most = _POSES_PER_STRAIN * self._node.parameters["queue_depth"]
        for subscription in self._poses:
            for _ in range(most):
                if not (self.session.waiting and self._take_next(subscription)):
                    break

    def _on_strain(self, message: StrainVectors, info: Mapping[str, int]) -> None:
        self._note_wait(info)
        newest_ns = self.newest_ns
        self._take("strain", message, self._add_strain, self._reader.read)
        if self.newest_ns != newest_ns:
            self._ahead_of_node_ns.add(self.newest_ns - self._node.now_ns)
        # Of a faster topic the executor leaves messages behind, and strain would not find its poses.
        self._take_poses()

    def _add_strain(self, stamp_ns: int, sample: StrainSample, received_ns: int | None) -> None:
        self._recent.append(sample[0])
        self.session.add_strain(stamp_ns, sample, received_ns)

    def _on_pose(self, message: PoseStamped, info: Mapping[str, int]) -> None:
        self._note_wait(info)
        self._add_pose(message)

    def _add_pose(self, message: PoseStamped) -> None:
        self._take("palm_pose", message, self.session.add_pose, self.position)

    def _note_wait(self, info: Mapping[str, int]) -> None:
        """Note how long a message has waited for this node: how much longer it was under way than others."""
        ahead_ns = info["source_timestamp"] - time.time_ns()
        self._ahead_of_sender_ns.add(ahead_ns)
        self._waits_ns.add(self._ahead_of_sender_ns.largest - ahead_ns)

    def _take(
        self,
        topic: str,
        message: Any,
        add: Callable[[int, Any, int | None], None],
        read: Callable[[Any], Any],
    ) -> None:
        """Pass on the pairs that a message completes, or reject it."""
        self.received[topic] += 1
        received_ns = None if self.behind else time.time_ns()
        try:
            add(stamp_of(message), read(message), received_ns)
        except TactileLocalizerError as error:
            self.reject(topic, error)
        else:
            self.problems.pop(topic, None)
            self._frames[topic].add(message.header.frame_id)
            self._on_pairs(self.session.take())
