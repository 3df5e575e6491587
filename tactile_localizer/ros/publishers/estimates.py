"""Publishers of the filter node's estimates."""

from __future__ import annotations

from typing import Any

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.lifecycle import LifecycleNodeMixin
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Bool, Float64
from visualization_msgs.msg import MarkerArray

from tactile_localizer.core.geometry.pose_buffer import NANOSECONDS
from tactile_localizer.core.identification import FeatureLocalizer
from tactile_localizer.core.localizer import Estimate, Localizer
from tactile_localizer.msg import FeatureProbabilities, Posterior
from tactile_localizer.ros.base.parameters import Parameters
from tactile_localizer.ros.conversions import hand_markers, posteriors

_RELIABLE = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)


class FilterOutputs:
    """The publishers of a filter node, silent unless it is active. It makes no message without a subscriber.

    Parameters
    ----------
    node : whose topics they are
    parameters : of that node
    """

    def __init__(self, node: LifecycleNodeMixin, parameters: Parameters) -> None:
        self._node = node
        self._parameters = parameters
        self._frame = parameters["material_frame"]
        # A generator of its own: subscribers must not change the estimates.
        self._rng = np.random.default_rng(0)
        self._shown_ns: int | None = None
        self._made: list[Any] = []

        def publisher(kind: Any, topic: str, quality: QoSProfile | int) -> Any:
            self._made.append(node.create_lifecycle_publisher(kind, topic, quality))
            return self._made[-1]

        self._posterior = publisher(Posterior, "~/posterior", _RELIABLE)
        self._feature = publisher(FeatureProbabilities, "~/feature", _RELIABLE)
        self._converged = publisher(Bool, "~/converged", _RELIABLE)
        self._trace = publisher(Float64, "~/covariance_trace", 100)
        self._pose = publisher(PoseWithCovarianceStamped, "~/pose", 100)
        self._particles = publisher(PointCloud2, "~/particles", 10)
        self._markers = publisher(MarkerArray, "~/markers", 10)

    def close(self) -> None:
        """Withdraw the topics."""
        for made in self._made:
            self._node.destroy_lifecycle_publisher(made)
        self._made = []

    def publish(self, estimate: Estimate, localizer: Localizer | FeatureLocalizer, stale: str = "") -> None:
        """Publish an estimate; ``stale`` is why it is old, empty where it is not."""
        axes = localizer.scene.axis_names
        self._posterior.publish(posteriors.posterior(estimate, axes, self._frame, stale))
        if isinstance(localizer, FeatureLocalizer) and localizer.identification is not None and not stale:
            feature = posteriors.feature(estimate.stamp_ns, localizer.identification, self._frame)
            self._feature.publish(feature)
        if _has_subscribers(self._converged):
            self._converged.publish(Bool(data=estimate.converged and not stale))
        if _has_subscribers(self._trace):
            self._trace.publish(Float64(data=estimate.trace))
        if _has_subscribers(self._pose) and not stale:
            self._pose.publish(posteriors.pose(estimate, axes, self._frame))
        if stale or self._is_due(estimate.stamp_ns):
            self._show(estimate, localizer, stale)

    def _is_due(self, stamp_ns: int) -> bool:
        """Whether ``particles_rate_hz`` allows another cloud, by stamps."""
        period_ns = NANOSECONDS / self._parameters["particles_rate_hz"]
        return self._shown_ns is None or not 0 <= stamp_ns - self._shown_ns < period_ns

    def _show(self, estimate: Estimate, localizer: Localizer | FeatureLocalizer, stale: str) -> None:
        self._shown_ns = estimate.stamp_ns
        scene = localizer.scene
        if _has_subscribers(self._markers):
            self._markers.publish(hand_markers.markers(estimate, scene, self._frame, stale))
        if _has_subscribers(self._particles) and not stale:
            states, weights = posteriors.fewer(
                *localizer.hypotheses(), self._parameters["shown_particles"], self._rng
            )
            self._particles.publish(
                posteriors.cloud(estimate.stamp_ns, states, scene.axis_names, self._frame, weight=weights)
            )


def _has_subscribers(publisher: Any) -> bool:
    return publisher.get_subscription_count() > 0
