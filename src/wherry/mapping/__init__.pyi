from .graph_slam import GraphSlam
from .graph_snapshot import GraphSnapshot
from .loop_closure import LoopClosure
from .methods import SLAM_METHODS, SlamMethod
from .odometry_check import ContradictionKind, OdometryContradiction, describe_contradictions
from .particle_slam import ParticleSlam
from .pose_graph import PoseGraph, optimized
from .rejections import Rejection
from .saved_graph import load_graph, save_graph
from .scan_matching_localizer import ScanMatchingLocalizer, locate_on_map
from .settings import GraphSlamSettings, ParticleSlamSettings, SlamSettings
from .slam import Slam

__all__ = [
    "SLAM_METHODS",
    "ContradictionKind",
    "GraphSlam",
    "GraphSlamSettings",
    "GraphSnapshot",
    "LoopClosure",
    "OdometryContradiction",
    "ParticleSlam",
    "ParticleSlamSettings",
    "PoseGraph",
    "Rejection",
    "ScanMatchingLocalizer",
    "Slam",
    "SlamMethod",
    "SlamSettings",
    "describe_contradictions",
    "load_graph",
    "locate_on_map",
    "optimized",
    "save_graph",
]
