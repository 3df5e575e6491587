"""A simulated hand on simulated flexible material; never imports rclpy."""
