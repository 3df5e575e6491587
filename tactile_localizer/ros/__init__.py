"""ROS 2 nodes, and the conversion between messages and the values of :mod:`tactile_localizer.core`."""
