"""What drivers of vehicles that nodes of ROS 1 and ROS 2 move have in common."""
