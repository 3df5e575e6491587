"""QoS profiles that differ from the default of ROS 2 (reliable, volatile)."""

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

STRAIN = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Of sensor data: a queue of 100 messages is 0.1 s at 1 kHz."""

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Of topics whose last message also reaches late subscribers."""
