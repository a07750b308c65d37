"""Buildings whose odometry was lost: mapped with odometry that drifts, made from the corrected poses of their logs.

The corrected poses are what an earlier SLAM made of the same scans, so the distance to them is a distance to another
estimate, and no smaller than that one's own error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wherry.evaluation import absolute_trajectory_error
from wherry.logs.carmen import read_log
from wherry.mapping.closures import Closure
from wherry.mapping.graph_slam import GraphSlam, GraphSlamSettings
from wherry.robot import Odometry, Velocity
from wherry.space.pose import Floats, Pose, compose, relative

SCALE_ERROR, STEP_ERROR = 0.02, 0.06  # σ of the share by which all steps, and by which each step, is wrong
FALSE_DISTANCE, FALSE_ANGLE = 1.0, math.radians(5.0)  # m and rad off the reference: a closure of two other places
BUILDINGS = ("aces", "csail", "fhw")


@dataclass(frozen=True, slots=True)
class Result:
    """A building mapped once.

    Attributes:
        building: Its name.
        seed: Of the drift.
        odometry_rmse_m: Root mean square error of the odometry, aligned.
        rmse_m: Likewise, of the trajectory.
        closures: Loops that were closed.
        false_closures: Those of them that are off the reference by more than a metre or five degrees.
        worst_closure_m: The farthest that one of them is off the reference.
    """

    building: str
    seed: int
    odometry_rmse_m: float
    rmse_m: float
    closures: int
    false_closures: int
    worst_closure_m: float


def drifted(poses: Floats, rng: np.random.Generator) -> Floats:
    """Odometry as it might have been.

    Args:
        poses: [N, 3] m, m, rad: how the robot moved.
        rng: Where the drift comes from.

    Returns:
        [N, 3] beginning at the origin; every increment is off by a share that all have in common and one of its own.
    """
    steps = relative(poses[1:], poses[:-1])
    wrong = steps * (1.0 + SCALE_ERROR * rng.normal(size=3)) + steps * STEP_ERROR * rng.normal(size=steps.shape)
    found = np.zeros_like(poses)
    for number, step in enumerate(wrong, start=1):
        found[number] = compose(found[number - 1], step)
    return found


def map_building(log_file: Path, name: str, seed: int) -> Result:
    """Map a building whose log has corrected poses.

    Args:
        log_file: The log.
        name: What it is called.
        seed: Of the drift.

    Raises:
        InputError: The log cannot be used.
    """
    log = read_log(log_file, lenient=True)
    reference = np.array([odometry.pose.as_array() for odometry in log.scan_odometry if odometry is not None])
    odometry = drifted(reference, np.random.default_rng(seed))
    slam = GraphSlam(log.lidar, GraphSlamSettings(empty_range=0.0))
    for scan, pose in zip(log.scans, odometry, strict=True):
        slam.add(scan, Odometry(scan.time, Pose.from_array(pose), Velocity()))
    slam.finish()
    accepted = [closure for closure in slam.closures if closure.accepted]
    off = closure_errors(slam, accepted, reference)
    return Result(
        name,
        seed,
        absolute_trajectory_error(odometry, reference),
        absolute_trajectory_error(slam.trajectory.poses, reference),
        len(accepted),
        int(((off[:, 0] > FALSE_DISTANCE) | (off[:, 1] > FALSE_ANGLE)).sum()),
        float(off[:, 0].max(initial=0.0)),
    )


def closure_errors(slam: GraphSlam, closures: list[Closure], reference: Floats) -> Floats:
    """[C, 2] m and rad: how far what closures measured is off the reference, [N, 3] poses of all scans."""
    scan_of: dict[int, int] = {}
    for number, (_, key, _) in enumerate(slam.passed):
        scan_of.setdefault(key, number)
    ends = np.array([[scan_of[closure.target], scan_of[closure.node]] for closure in closures], np.int64).reshape(-1, 2)
    measured = np.array([closure.measured.as_array() for closure in closures]).reshape(-1, 3)
    off = relative(measured, relative(reference[ends[:, 1]], reference[ends[:, 0]]))
    return np.column_stack([np.hypot(off[:, 0], off[:, 1]), np.abs(off[:, 2])])
