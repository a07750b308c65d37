"""Global localization: drives the robot around on a given map until its pose is known."""

from __future__ import annotations

import math

import numpy as np
from scipy import ndimage

from wherry.errors import InputError
from wherry.localization.localizer import Localizer
from wherry.localization.parameters import PRECISE_PARAMETERS
from wherry.realization.pilot import Pilot
from wherry.realization.pose_estimators import LOCALIZED_MIN_SCANS, GlobalPoseEstimator, MapPoseEstimator, check_fit
from wherry.realization.pose_tracker import PoseTracker
from wherry.robot import Robot
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry.trace.records import Narration, Phase, Sink

MAX_LEGS = 30  # straight drives after which global localization fails
MAX_SYMMETRIC_LEGS = 6  # straight drives after which poses that agree equally with all scans are accepted
TIMEOUT = 300.0  # s, robot's clock, after which global localization fails
LEG_LENGTH = 1.5  # m, longest straight drive
LEG_HALF_SECTOR = math.radians(20.0)  # half the angle of the sector around a leg that must be clear
LEG_MIN_CLEARANCE = 0.8  # clear distance of a leg ÷ largest clear distance in any direction


def localize_globally(robot: Robot, grid: OccupancyGrid, sink: Sink, rng: np.random.Generator) -> tuple[Pilot, Pose]:
    """Drive in random directions until the robot is localized on a map.

    Args:
        robot: The robot.
        grid: The map.
        sink: Called with snapshots of the robot and narration.
        rng: Source of all randomness.

    Returns:
        A pilot that tracks the pose on the map, and the initial pose of base_link in the map frame.

    Raises:
        InputError: The scans do not fit the map, or the robot could not be localized in `MAX_LEGS` legs or `TIMEOUT`.
    """
    localizer = Localizer(grid, robot.body.lidar, PRECISE_PARAMETERS, rng)
    localizer.initialize_globally()
    estimator = GlobalPoseEstimator(localizer)
    pilot = Pilot(robot, PoseTracker(estimator, Pose()), sink)
    sink(Narration(pilot.time, Phase.LOCALIZE, "I have a map, but I do not know my pose on it."))
    start = pilot.odometry.pose
    pilot.wait_for_scan(LOCALIZED_MIN_SCANS)
    _drive_until_localized(pilot, estimator, rng)
    map_from_start = estimator.map_pose @ pilot.odometry.pose.inverse @ start
    pilot.use_tracker(PoseTracker(MapPoseEstimator(localizer, is_map_given=True), estimator.map_pose))
    sink(Narration(pilot.time, Phase.LOCALIZE, "I am localized."))
    return pilot, map_from_start


def _drive_until_localized(pilot: Pilot, estimator: GlobalPoseEstimator, rng: np.random.Generator) -> None:
    """Drive in random directions until the robot is localized.

    Raises:
        InputError: As `localize_globally`.
    """
    deadline = pilot.time + TIMEOUT
    for leg in range(MAX_LEGS):
        if estimator.is_localized or (leg >= MAX_SYMMETRIC_LEGS and estimator.is_localized_up_to_symmetry):
            return
        if pilot.time > deadline:
            break
        check_fit(estimator.fit)
        _drive_random_leg(pilot, rng)
    raise InputError("map", "", "does not fit what the lidar sees, or looks the same in several places")


def _drive_random_leg(pilot: Pilot, rng: np.random.Generator) -> None:
    """Drive straight in a random direction with a large clear distance, to scan from another position."""
    scan = pilot.wait_for_scan()
    lengths = np.where(np.isnan(scan.ranges), 0.0, np.minimum(scan.ranges, LEG_LENGTH + pilot.body.radius))
    half = max(round(LEG_HALF_SECTOR / abs(scan.angle_increment)), 1)
    clear = ndimage.minimum_filter1d(lengths, 2 * half + 1, mode="wrap")
    beam = int(rng.choice(np.flatnonzero(clear >= LEG_MIN_CLEARANCE * clear.max())))
    pilot.turn_to(pilot.pose.theta + float(scan.angles[beam]))
    leg = max(float(clear[beam]) - 2.0 * pilot.body.radius, 0.0)
    pilot.approach(pilot.pose @ Pose(leg), reverse=False)
