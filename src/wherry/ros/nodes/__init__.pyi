from .agent import AgentNode
from .errors import RobotLostError
from .external import ExternalMap, ExternalMapper, ExternalPose
from .latch_protocol import LatchCommand, LatchState
from .monitor import Monitor
from .robot import RosRobot
from .simulator import SimulatorNode, simulator_node

__all__ = [
    "AgentNode",
    "ExternalMap",
    "ExternalMapper",
    "ExternalPose",
    "LatchCommand",
    "LatchState",
    "Monitor",
    "RobotLostError",
    "RosRobot",
    "SimulatorNode",
    "simulator_node",
]
