"""Conversion of estimates to messages."""

from __future__ import annotations

import math
from array import array

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from tactile_localizer.core.filters.resampling import systematic
from tactile_localizer.core.localizer import Estimate
from tactile_localizer.msg import Posterior
from tactile_localizer.ros.conversions.timestamps import from_ns

_COVARIANCE_INDEX = {"x": 0, "y": 1, "yaw": 5}
"""Row of each axis in the covariance of a pose: x, y, z and the rotations about x, y, z."""

UNKNOWN_VARIANCE = 1e6
"""Variance of unmodelled axes of a pose, m² or rad²; fusion nodes interpret zero as certainty."""


def state_of(estimate: Estimate, stale: str = "") -> int:
    """The state of a ``Posterior``; ``stale`` is the reason why the estimate is stale, or empty."""
    return int(Posterior.STALE if stale else getattr(Posterior, estimate.state.name))


def posterior(estimate: Estimate, axes: tuple[str, ...], frame: str, stale: str = "") -> Posterior:
    """The message of an estimate; if ``stale`` gives a reason, the state is ``STALE`` and not converged."""
    message = Posterior()
    message.header = _header(estimate.stamp_ns, frame)
    message.axes = list(axes)
    message.mean = array("d", estimate.mean.tobytes())
    message.covariance = array("d", np.ascontiguousarray(estimate.covariance).tobytes())
    message.covariance_trace = estimate.trace
    message.state = state_of(estimate, stale)
    message.converged = message.state == Posterior.CONVERGED
    message.reason = f"stale: {stale}" if stale else estimate.reason
    message.probability = estimate.probability
    message.on_map = estimate.on_map
    message.log_marginal = estimate.log_marginal
    message.effective_sample_size = estimate.effective_sample_size
    message.particles = estimate.hypotheses
    message.travel = estimate.travel
    message.stale = message.state == Posterior.STALE
    return message


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


def subsample(
    states: np.ndarray, weights: np.ndarray, limit: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """At most ``limit`` of the states (P, d), resampled, with the summed weights of their copies."""
    if len(states) <= limit:
        return states, weights
    kept, copies = np.unique(systematic(weights, limit, rng), return_counts=True)
    return states[kept], copies / limit


def _header(stamp_ns: int, frame: str) -> Header:
    return Header(stamp=from_ns(stamp_ns), frame_id=frame)
