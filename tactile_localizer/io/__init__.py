"""Files, recordings and the CAN bus; never imports rclpy."""
