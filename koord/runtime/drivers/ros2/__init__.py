"""The driver of vehicles that nodes of ROS 2 move."""
