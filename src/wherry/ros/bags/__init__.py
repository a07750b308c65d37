"""ROS bags: reading them as lidar logs, and recording runs, logs and ROS nodes."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
