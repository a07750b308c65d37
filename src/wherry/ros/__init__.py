"""ROS: our agent on any ROS robot, and our simulator for any ROS stack, over ROS 1 or ROS 2."""
