"""Replay, metrics, figures and the speed-accuracy trade; never imports rclpy."""
