"""Files, recordings and the CAN bus, without ROS."""
