"""ROS 1 and ROS 2: messages, names, transports and bags; the agent on any ROS robot, the simulator for any stack."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
