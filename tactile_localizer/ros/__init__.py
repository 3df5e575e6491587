"""ROS 2 nodes: declare parameters, wire topics, convert messages, call the layers below."""
