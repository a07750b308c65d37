from .drive import WheelOdometryErrors
from .faults import blind, kidnap, random_pose, slippery
from .lidar import LidarSpecification
from .model import BODY, robot_urdf
from .referee import BoxStatus, BoxTruth, Collision, Referee
from .rendering import SceneRenderer
from .seeded_worlds import SeededWorld, seed_world
from .simulator import Simulation, build

__all__ = [
    "BODY",
    "BoxStatus",
    "BoxTruth",
    "Collision",
    "LidarSpecification",
    "Referee",
    "SceneRenderer",
    "SeededWorld",
    "Simulation",
    "WheelOdometryErrors",
    "blind",
    "build",
    "kidnap",
    "random_pose",
    "robot_urdf",
    "seed_world",
    "slippery",
]
