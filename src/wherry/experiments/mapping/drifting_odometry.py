"""Recorded buildings whose logs lack odometry, mapped with drifting odometry simulated from their corrected poses.

The corrected poses are the result of an earlier SLAM on the same scans, so errors against them are differences between
two estimates, and no smaller than the error of the earlier one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wherry.evaluation import absolute_trajectory_error
from wherry.logs.options import ReadingOptions
from wherry.logs.reading import read_log
from wherry.mapping.graph_slam import GraphSlam
from wherry.mapping.loop_closure import LoopClosure
from wherry.mapping.settings import GraphSlamSettings
from wherry.robot import Odometry, Velocity
from wherry.space.pose import Floats, Pose, compose, relative

SCALE_SIGMA = 0.02  # standard deviation of the scale error that all steps of a log share
STEP_SIGMA = 0.06  # standard deviation of the scale error of each step
FALSE_DISTANCE, FALSE_ANGLE = 1.0, math.radians(5.0)  # m and rad, errors above which a closure counts as false
BUILDINGS = ("aces", "csail", "fhw")


@dataclass(frozen=True, slots=True)
class BuildingResult:
    """Errors of one map of a building.

    Attributes:
        building: Name of the building.
        seed: Seed of the odometry's drift.
        odometry_rmse_m: Root mean square error of the odometry after alignment, m.
        rmse_m: Root mean square error of the trajectory after alignment, m.
        closures: Number of accepted loop closures.
        false_closures: Number of accepted loop closures off the reference by more than a metre or five degrees.
        worst_closure_m: Largest distance of an accepted loop closure from the reference, m.
    """

    building: str
    seed: int
    odometry_rmse_m: float
    rmse_m: float
    closures: int
    false_closures: int
    worst_closure_m: float


def drifting_odometry(poses: Floats, rng: np.random.Generator) -> Floats:
    """Simulate odometry with a scale error.

    Args:
        poses: True poses, [N, 3] m, m, rad.
        rng: Source of the errors.

    Returns:
        Odometry that begins at the origin, [N, 3] m, m, rad; every step has a scale error that all steps share, and one
        of its own.
    """
    steps = relative(poses[1:], poses[:-1])
    erroneous = steps * (1.0 + SCALE_SIGMA * rng.normal(size=3)) + steps * STEP_SIGMA * rng.normal(size=steps.shape)
    odometry = np.zeros_like(poses)
    for number, step in enumerate(erroneous, start=1):
        odometry[number] = compose(odometry[number - 1], step)
    return odometry


def building_log(name: str) -> Path:
    """Path of a building's log below the folder of recorded logs."""
    return Path("radish") / f"{name}-corrected.log.gz"


def map_building(log_file: Path, name: str, seed: int) -> BuildingResult:
    """Map a building whose log has corrected poses.

    Args:
        log_file: The log.
        name: Name of the building.
        seed: Seed of the drift.

    Raises:
        InputError: The log cannot be used.
    """
    log = read_log(log_file, ReadingOptions(lenient=True))
    reference = np.array([odometry.pose.as_array() for odometry in log.scan_odometry if odometry is not None])
    odometry = drifting_odometry(reference, np.random.default_rng(seed))
    slam = GraphSlam(log.lidar, GraphSlamSettings(empty_range=0.0))
    for scan, pose in zip(log.scans, odometry, strict=True):
        slam.add(scan, Odometry(scan.time, Pose.from_array(pose), Velocity()))
    slam.finish()
    accepted = [closure for closure in slam.loop_closures if closure.is_accepted]
    errors = closure_errors(slam.snapshot().keyframe_scans, accepted, reference)
    return BuildingResult(
        name,
        seed,
        absolute_trajectory_error(odometry, reference),
        absolute_trajectory_error(slam.trajectory.poses, reference),
        len(accepted),
        int(((errors[:, 0] > FALSE_DISTANCE) | (errors[:, 1] > FALSE_ANGLE)).sum()),
        float(errors[:, 0].max(initial=0.0)),
    )


def closure_errors(keyframe_scans: NDArray[np.int64], closures: Sequence[LoopClosure], reference: Floats) -> Floats:
    """Errors of the measured poses of loop closures.

    Args:
        keyframe_scans: Index of the scan at each keyframe, [K], see `GraphSnapshot.keyframe_scans`.
        closures: Loop closures, C.
        reference: True poses of all scans, [N, 3] m, m, rad.

    Returns:
        Distances and angles off the reference, [C, 2] m, rad.
    """
    keyframes = np.array([[closure.target, closure.keyframe] for closure in closures], np.int64).reshape(-1, 2)
    ends = keyframe_scans[keyframes]
    measured = np.array([closure.measured.as_array() for closure in closures]).reshape(-1, 3)
    offsets = relative(measured, relative(reference[ends[:, 1]], reference[ends[:, 0]]))
    return np.column_stack([np.hypot(offsets[:, 0], offsets[:, 1]), np.abs(offsets[:, 2])])
