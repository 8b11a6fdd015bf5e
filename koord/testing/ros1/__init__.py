"""A car as a node of ROS 1, to try drivers on."""
