"""Worlds, robot and latch for Gazebo."""
