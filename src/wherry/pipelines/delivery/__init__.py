"""Deliveries: in simulation and over ROS, their score, report and film."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
