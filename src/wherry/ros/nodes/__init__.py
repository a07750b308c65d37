"""Nodes: a ROS robot for the agent, the agent's publications, the simulated robot's driver, and a monitor."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
