"""Gazebo: worlds with the robot for Gazebo Sim and classic Gazebo, and the node that operates the latch."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
