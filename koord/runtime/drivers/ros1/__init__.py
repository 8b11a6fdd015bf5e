"""The driver of vehicles that nodes of ROS 1 move."""
