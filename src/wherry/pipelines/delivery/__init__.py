"""Deliveries: in simulation and over ROS, their score, report and film."""
