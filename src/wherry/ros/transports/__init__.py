"""Transports of ROS messages: ROS 1 through rospy, ROS 2 through DDS; each is imported when it is first used."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
