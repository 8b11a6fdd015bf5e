"""A car as a node of ROS 2."""
