"""Replay, metrics, evaluation, figures and reports; no ROS."""
