"""ROS 1 and ROS 2 as transports of messages."""
