"""Conversions between ROS messages and values of the core."""
