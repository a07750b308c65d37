from .box_detection import detect_cylinders
from .box_tracks import BoxTrack, update_tracks
from .cells import blocked_directions, floor_plan_from_map
from .environment import RobotEnvironment
from .mission import Mission, Order, SurveyedWorld, order_from_plan
from .pilot import DriveStatus, Pilot
from .pose_estimators import GlobalPoseEstimator, Mapper, MapPoseEstimator, SlamMapper, SlamPoseEstimator
from .pose_tracker import PoseEstimator, PoseTracker, SinglePoseEstimator
from .surveyor import CellMap, Surveyor

__all__ = [
    "BoxTrack",
    "CellMap",
    "DriveStatus",
    "GlobalPoseEstimator",
    "MapPoseEstimator",
    "Mapper",
    "Mission",
    "Order",
    "Pilot",
    "PoseEstimator",
    "PoseTracker",
    "RobotEnvironment",
    "SinglePoseEstimator",
    "SlamMapper",
    "SlamPoseEstimator",
    "SurveyedWorld",
    "Surveyor",
    "blocked_directions",
    "detect_cylinders",
    "floor_plan_from_map",
    "order_from_plan",
    "update_tracks",
]
