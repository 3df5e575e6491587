"""Publishers of the estimates of the filter node."""

from __future__ import annotations

from typing import Any

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.lifecycle import LifecycleNodeMixin
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Bool, Float64
from visualization_msgs.msg import MarkerArray

from tactile_localizer.core.geometry.pose_buffer import NANOSECONDS
from tactile_localizer.core.localizer import Estimate, Localizer
from tactile_localizer.msg import Posterior
from tactile_localizer.ros.base.parameters import Parameters
from tactile_localizer.ros.conversions import hand_markers, posteriors


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
        # A separate generator: subscribers must not influence the estimates.
        self._rng = np.random.default_rng(0)
        self._displayed_ns: int | None = None
        self._posterior = node.create_lifecycle_publisher(Posterior, "~/posterior", 100)
        self._converged = node.create_lifecycle_publisher(Bool, "~/converged", 100)
        self._trace = node.create_lifecycle_publisher(Float64, "~/covariance_trace", 100)
        self._pose = node.create_lifecycle_publisher(PoseWithCovarianceStamped, "~/pose", 100)
        self._particles = node.create_lifecycle_publisher(PointCloud2, "~/particles", 10)
        self._markers = node.create_lifecycle_publisher(MarkerArray, "~/markers", 10)

    def publish(self, estimate: Estimate, localizer: Localizer, stale: str = "") -> None:
        """Publish an estimate; ``stale`` is the reason why it is stale, or empty."""
        axes = localizer.scene.axis_names
        self._posterior.publish(posteriors.posterior(estimate, axes, self._frame, stale))
        if _has_subscribers(self._converged):
            self._converged.publish(Bool(data=estimate.converged and not stale))
        if _has_subscribers(self._trace):
            self._trace.publish(Float64(data=estimate.trace))
        if _has_subscribers(self._pose) and not stale:
            self._pose.publish(posteriors.pose(estimate, axes, self._frame))
        if stale or self._is_display_due(estimate.stamp_ns):
            self._display(estimate, localizer, stale)

    def publish_waiting(self, stamp_ns: int, localizer: Localizer, reason: str) -> None:
        """Publish that there is no estimate yet; ``reason`` is what the filter waits for."""
        axes = localizer.scene.axis_names
        self._posterior.publish(
            posteriors.waiting(stamp_ns, localizer.hypotheses(), axes, self._frame, reason)
        )

    def _is_display_due(self, stamp_ns: int) -> bool:
        period_ns = NANOSECONDS / self._parameters["particles_rate_hz"]
        return self._displayed_ns is None or not 0 <= stamp_ns - self._displayed_ns < period_ns

    def _display(self, estimate: Estimate, localizer: Localizer, stale: str) -> None:
        self._displayed_ns = estimate.stamp_ns
        scene = localizer.scene
        if _has_subscribers(self._markers):
            self._markers.publish(hand_markers.markers(estimate, scene, self._frame, stale))
        if _has_subscribers(self._particles) and not stale:
            states, weights = posteriors.subsample(
                *localizer.hypotheses(), self._parameters["shown_particles"], self._rng
            )
            cloud = posteriors.cloud(estimate.stamp_ns, states, scene.axis_names, self._frame, weight=weights)
            self._particles.publish(cloud)


def _has_subscribers(publisher: Any) -> bool:
    return publisher.get_subscription_count() > 0
