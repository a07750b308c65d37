"""What every value that a loader returns must satisfy, whatever was in the file."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from wherry.evaluation import Relations
from wherry.floorplan.plan import FloorPlan
from wherry.floorplan.world_files import format_world, parse_world
from wherry.gazebo.latch_settings import GazeboLatchSettings
from wherry.learning.rules import RuleLearner
from wherry.localization.parameter_files import LoadedParameters
from wherry.logs.lidar_log import MAX_BEAMS, LidarLog
from wherry.mapping.graph_slam import GraphSlam
from wherry.mapping.graph_snapshot import GraphSnapshot
from wherry.ros.body_files import BodyParameters
from wherry.ros.names import FRAME_NAME, TOPIC_NAME, RosNames
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry.space.trajectory import Trajectory
from wherry.trace.records import MapUpdate, RobotSnapshot

MAX_COORDINATE = 1e9  # m, of a pose
MAX_TIME = 1e18  # s
MAX_SIDE = 20_000.0  # m, of a map
MAX_CELLS = 100_000_000  # of a map


def require(condition: object, statement: str) -> None:
    """Raise an `AssertionError` unless the condition holds."""
    if not condition:
        raise AssertionError(statement)


def check_pose(pose: Pose) -> None:
    """A pose is finite and bounded."""
    values = [pose.x, pose.y, pose.theta]
    require(all(math.isfinite(value) and abs(value) <= MAX_COORDINATE for value in values), f"{pose} is out of bounds")


def check_trajectory(trajectory: Trajectory) -> None:
    """Times are finite and do not decrease; poses are finite and bounded."""
    require(len(trajectory.times) == len(trajectory.poses), "as many times as poses")
    require(np.isfinite(trajectory.times).all() and (np.abs(trajectory.times) <= MAX_TIME).all(), "times are finite")
    require((np.diff(trajectory.times) >= 0.0).all(), "times are ordered")
    require(np.isfinite(trajectory.poses).all(), "poses are finite")
    require((np.abs(trajectory.poses[:, :2]) <= MAX_COORDINATE).all(), "poses are bounded")


def check_log(log: LidarLog) -> None:
    """Scans are ordered and can be used, and as many odometry readings as scans."""
    require(log.scans and len(log.scan_odometry) == len(log.scans), "scans with odometry")
    times = np.array([scan.time for scan in log.scans])
    require(np.isfinite(times).all() and (np.diff(times) >= 0.0).all(), "times of scans are ordered")
    for scan in log.scans:
        require(1 <= len(scan.ranges) <= MAX_BEAMS, "number of beams")
        require(0.0 <= scan.range_min < scan.range_max <= MAX_COORDINATE, "limits of the range")
        require(np.isfinite(scan.points()).all(), "end points are finite")
        require(np.isfinite(scan.angles).all() and len(scan.angles) == len(scan.ranges), "directions are finite")
        require(np.ptp(scan.angles) <= 4.0 * math.pi, "directions cover two turns at most")
        require(math.isfinite(scan.time_increment), "time_increment is finite")
    for odometry in log.scan_odometry:
        if odometry is not None:
            check_pose(odometry.pose)
    check_trajectory(log.odometry)
    check_pose(log.lidar)
    for index in (0, len(log.scans) - 1):
        require(len(log.deskewed(index).ranges) == len(log.scans[index].ranges), "a deskewed scan has all beams")
    require(all(note.isprintable() for note in (*log.notes, *log.skipped)), "notes are single lines")


def check_relations(relations: Relations) -> None:
    """Times and poses are finite."""
    require(np.isfinite(relations.times).all() and np.isfinite(relations.poses).all(), "relations are finite")
    require((np.abs(relations.poses) <= MAX_COORDINATE).all(), "relations are bounded")


def check_grid(grid: OccupancyGrid) -> None:
    """Probabilities are between 0 and 1, and the map is of possible size."""
    probability = grid.probability
    require(probability.dtype == np.float32 and probability.ndim == 2, "an array of float32")
    require(1 <= probability.size <= MAX_CELLS, "number of cells")
    require(float(probability.min()) >= 0.0 and float(probability.max()) <= 1.0, "probabilities")
    require(not math.isnan(float(probability.sum())), "probabilities are numbers")
    require(0.0 < grid.resolution * max(grid.shape) <= MAX_SIDE, "size in metres")
    check_pose(grid.origin)
    require(grid.centres(np.array([[0, 0], [grid.shape[0] - 1, grid.shape[1] - 1]])).dtype == np.float64, "centres")


def check_parameters(loaded: LoadedParameters) -> None:
    """Numbers are finite, except the longest range, which may be unlimited, and types are those of the fields."""
    for name in type(loaded.parameters).__dataclass_fields__:
        value = getattr(loaded.parameters, name)
        if isinstance(value, float) and name != "laser_max_range":
            require(math.isfinite(value), f"{name} is finite")
        default = type(loaded.parameters).__dataclass_fields__[name].default
        require(type(value) is type(default) or isinstance(default, float), f"{name} has its type")
    check_pose(loaded.parameters.initial_pose)


def check_names(names: RosNames) -> None:
    """Names are such that ROS allows."""
    for name in type(names.topics).__dataclass_fields__:
        require(TOPIC_NAME.fullmatch(getattr(names.topics, name).name), f"topic {name}")
    for name in type(names.frames).__dataclass_fields__:
        require(FRAME_NAME.fullmatch(getattr(names.frames, name)), f"frame {name}")
    for name in type(names.rates).__dataclass_fields__:
        require(0.0 < getattr(names.rates, name) <= 1000.0, f"rate {name}")


def check_body(body: BodyParameters) -> None:
    """Numbers are positive and bounded."""
    for name in ("radius", "box_radius", "max_linear", "max_angular", "max_linear_acceleration"):
        require(0.0 < getattr(body, name) <= 100.0, name)
    body.body(Pose())
    if body.lidar is not None:
        check_pose(body.lidar)


def check_latch(settings: GazeboLatchSettings) -> None:
    """Numbers are in their ranges."""
    require(0 <= settings.boxes <= 1000 and 0.0 < settings.reach <= 10.0 and 0.0 < settings.cell_size <= 10.0, "sizes")
    settings.is_over_warehouse(Pose(1.0, 1.0))


def check_plan(plan: FloorPlan) -> None:
    """A world is the same after it is written and read; the plan itself checks its contents."""
    require(parse_world(format_world(plan), "again") == plan, "the same world after writing")


def check_rules(learner: RuleLearner) -> None:
    """Rules can be told in words."""
    require(all(isinstance(sentence, str) for sentence in learner.sentences()), "sentences")


def check_graph(snapshot: GraphSnapshot) -> None:
    """Poses and constraints are finite and refer to nodes; mapping can continue."""
    require(np.isfinite(snapshot.keyframe_poses).all(), "poses are finite")
    require((np.abs(snapshot.keyframe_poses) <= MAX_COORDINATE).all(), "poses are bounded")
    require(len(snapshot.keyframe_poses) == len(snapshot.keyframes), "a pose for each keyframe")
    for keyframe in snapshot.keyframes:
        require(np.isfinite(keyframe.scan.points()).all(), "end points are finite")
    check_pose(snapshot.lidar)
    GraphSlam.from_snapshot(snapshot)


def check_records(records: list[Any]) -> None:
    """Times and arrays are finite."""
    require(records, "records")
    for record in records:
        if isinstance(record, RobotSnapshot):
            check_pose(record.pose)
            for name in ("points", "particles", "path", "boxes"):
                require(np.isfinite(getattr(record, name)).all(), f"{name} are finite")
        if isinstance(record, MapUpdate):
            check_grid(record.grid)
