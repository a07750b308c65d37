"""Deliveries: in the simulator, over ROS, and what is told and scored of them."""
