"""ROS bags, read and recorded."""
