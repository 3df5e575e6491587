"""Publishers of the estimates of the filter node."""

import math
from array import array

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.lifecycle import LifecycleNodeMixin
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Bool, Header
from visualization_msgs.msg import MarkerArray

from tactile_localizer.core.filters.resampling import systematic
from tactile_localizer.core.localizer import Estimate, Localizer
from tactile_localizer.msg import Posterior
from tactile_localizer.ros.base.parameters import Parameters
from tactile_localizer.ros.base.qos import LATCHED
from tactile_localizer.ros.conversions import from_ns
from tactile_localizer.ros.publishers import hand_markers
from tactile_localizer.streams.runs import NANOSECONDS

_COVARIANCE_INDEX = {"x": 0, "y": 1, "yaw": 5}
"""Row of each axis in the covariance of a pose: x, y, z and the rotations about x, y, z."""

UNKNOWN_VARIANCE = 1e6
"""Variance of unmodelled axes of a pose, m² or rad²; fusion nodes interpret zero as certainty."""


def fill_posterior(message: Posterior, estimate: Estimate, axes: tuple[str, ...], stale: str = "") -> None:
    """Fill in an estimate; if ``stale`` gives a reason, the state is ``STALE`` and not converged.

    All fields are set but the frame, so that a message can be used again: making one takes longer.
    """
    stamp = message.header.stamp
    stamp.sec, stamp.nanosec = divmod(estimate.stamp_ns, NANOSECONDS)
    message.axes = list(axes)
    message.mean = array("d", estimate.mean.tobytes())
    message.covariance = array("d", np.ascontiguousarray(estimate.covariance).tobytes())
    message.covariance_trace = estimate.trace
    message.state = Posterior.STALE if stale else getattr(Posterior, estimate.state.name)
    message.converged = message.state == Posterior.CONVERGED
    message.reason = f"stale: {stale}" if stale else estimate.reason
    message.probability = estimate.probability
    message.on_map = estimate.on_map
    message.log_marginal = estimate.log_marginal
    message.effective_sample_size = estimate.effective_sample_size
    message.particles = estimate.hypotheses
    message.travel = estimate.travel
    message.stale = message.state == Posterior.STALE


def pose(estimate: Estimate, axes: tuple[str, ...], frame: str) -> PoseWithCovarianceStamped:
    """Mean and covariance of an estimate; unmodelled axes have :data:`UNKNOWN_VARIANCE`."""
    message = PoseWithCovarianceStamped()
    message.header = _header(estimate.stamp_ns, frame)
    values = dict(zip(axes, estimate.mean.tolist(), strict=True))
    message.pose.pose.position.x = values.get("x", 0.0)
    message.pose.pose.position.y = values.get("y", 0.0)
    half_yaw = values.get("yaw", 0.0) / 2
    message.pose.pose.orientation.z, message.pose.pose.orientation.w = math.sin(half_yaw), math.cos(half_yaw)
    rows = [_COVARIANCE_INDEX[axis] for axis in axes]
    covariance = UNKNOWN_VARIANCE * np.eye(6)
    covariance[np.ix_(rows, rows)] = estimate.covariance
    message.pose.covariance = covariance.ravel()
    return message


def waiting(
    stamp_ns: int, hypotheses: tuple[np.ndarray, np.ndarray], axes: tuple[str, ...], frame: str, reason: str
) -> Posterior:
    """The message of a belief without any estimate yet: moments of its hypotheses, state ``STALE``.

    Parameters
    ----------
    stamp_ns : time of the message, ns
    hypotheses : states (P, d), m (yaw: rad), and weights (P,)
    axes, frame : names of the axes, and frame of the material
    reason : what the filter waits for
    """
    states, weights = hypotheses
    covariance = np.atleast_2d(np.cov(states, rowvar=False, aweights=weights, ddof=0))
    message = Posterior(header=_header(stamp_ns, frame), state=Posterior.STALE, stale=True)
    message.axes, message.reason = list(axes), f"stale: {reason}"
    message.mean = array("d", np.average(states, axis=0, weights=weights).tobytes())
    message.covariance = array("d", covariance.tobytes())
    message.covariance_trace = float(covariance.trace())
    message.particles = len(states)
    return message


def standard_deviations(message: PoseWithCovarianceStamped, axes: tuple[str, ...]) -> np.ndarray:
    """Standard deviations (d,) of a pose on ``axes``, m (yaw: rad); NaN for a negative variance."""
    rows = [_COVARIANCE_INDEX[axis] for axis in axes]
    variances = np.asarray(message.pose.covariance).reshape(6, 6).diagonal()[rows]
    return np.sqrt(np.where(variances >= 0.0, variances, math.nan))


def cloud(
    stamp_ns: int, states: np.ndarray, axes: tuple[str, ...], frame: str, **values: np.ndarray
) -> PointCloud2:
    """States (P, d) as points with fields x, y, z, yaw (if modelled) and one per entry of ``values`` (P,)."""
    columns = {"x": np.zeros(len(states)), "y": np.zeros(len(states)), "z": np.zeros(len(states))}
    columns.update(zip(axes, states.T, strict=True))
    columns.update(values)
    data = np.stack(list(columns.values()), axis=1, dtype="<f4", casting="same_kind")
    message = PointCloud2(height=1, width=len(data), is_dense=True)
    message.header = _header(stamp_ns, frame)
    message.fields = [
        PointField(name=name, offset=4 * i, datatype=PointField.FLOAT32, count=1)
        for i, name in enumerate(columns)
    ]
    message.point_step = 4 * len(columns)
    message.row_step = message.point_step * len(data)
    message.data = array("B", data.tobytes())
    return message


def _header(stamp_ns: int, frame: str) -> Header:
    return Header(stamp=from_ns(stamp_ns), frame_id=frame)


class EstimatePublisher:
    """Publishes estimates while the node is active; optional messages only if they have a subscriber.

    Parameters
    ----------
    node : node that publishes
    parameters : parameters of that node
    """

    def __init__(self, node: LifecycleNodeMixin, parameters: Parameters) -> None:
        self._parameters = parameters
        self._frame = parameters["material_frame"]
        self._message = Posterior(header=Header(frame_id=self._frame))
        # A separate generator: subscribers must not influence the estimates.
        self._rng = np.random.default_rng(0)
        self._displayed_ns, self._period_ns = -math.inf, 0.0
        depth = parameters["queue_depth"]  # strain that has waited gives as many estimates at once
        self._posterior = node.create_lifecycle_publisher(Posterior, "~/posterior", depth)
        self._converged = node.create_lifecycle_publisher(Bool, "~/converged", depth)
        self._pose = node.create_lifecycle_publisher(PoseWithCovarianceStamped, "~/pose", LATCHED)
        self._particles = node.create_lifecycle_publisher(PointCloud2, "~/particles", 10)
        self._markers = node.create_lifecycle_publisher(MarkerArray, "~/markers", 10)

    def publish(self, estimate: Estimate, localizer: Localizer, stale: str = "") -> None:
        """Publish an estimate; ``stale`` is the reason why it is stale, or empty."""
        axes = localizer.scene.axis_names
        fill_posterior(self._message, estimate, axes, stale)
        self._posterior.publish(self._message)
        if self._converged.get_subscription_count():
            self._converged.publish(Bool(data=estimate.converged and not stale))
        is_displayed = stale or not 0 <= estimate.stamp_ns - self._displayed_ns < self._period_ns
        if not stale and (
            is_displayed or self._pose.get_subscription_count()
        ):  # the last is for late subscribers
            self._pose.publish(pose(estimate, axes, self._frame))
        if is_displayed:
            self._display(estimate, localizer, stale)

    def publish_waiting(self, stamp_ns: int, localizer: Localizer, reason: str) -> None:
        """Publish that there is no estimate yet; ``reason`` is what the filter waits for."""
        axes = localizer.scene.axis_names
        self._posterior.publish(waiting(stamp_ns, localizer.hypotheses(), axes, self._frame, reason))

    def _display(self, estimate: Estimate, localizer: Localizer, stale: str) -> None:
        self._displayed_ns = estimate.stamp_ns
        self._period_ns = NANOSECONDS / self._parameters["particles_rate_hz"]
        scene = localizer.scene
        if self._markers.get_subscription_count():
            self._markers.publish(hand_markers.markers(estimate, scene, self._frame, stale))
        if self._particles.get_subscription_count() and not stale:
            states, weights = localizer.hypotheses()
            if len(states) > (shown := self._parameters["shown_particles"]):
                kept, copies = np.unique(systematic(weights, shown, self._rng), return_counts=True)
                states, weights = states[kept], copies / shown
            message = cloud(estimate.stamp_ns, states, scene.axis_names, self._frame, weight=weights)
            self._particles.publish(message)
