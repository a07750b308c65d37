"""Nodes: a robot of ROS for the agent, the agent's publications, the simulator's driver, and a monitor."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
