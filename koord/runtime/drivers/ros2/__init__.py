"""The driver ``ros2``: vehicles that are moved by nodes of ROS 2, reached by DDS."""
