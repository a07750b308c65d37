from .drive import WheelOdometryErrors
from .faults import blind_lidar, cell_pose, kidnap, random_cell_pose, random_pose, reachable_cells, slippery_wheels
from .ground_truth import true_map
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
    "blind_lidar",
    "build",
    "cell_pose",
    "kidnap",
    "random_cell_pose",
    "random_pose",
    "reachable_cells",
    "robot_urdf",
    "seed_world",
    "slippery_wheels",
    "true_map",
]
