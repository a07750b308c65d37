from .protocol import Transport
from .ros1 import Ros1Transport
from .ros2 import Ros2Transport

__all__ = ["Ros1Transport", "Ros2Transport", "Transport"]
