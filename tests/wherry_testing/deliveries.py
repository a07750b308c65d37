"""Simulated robots as environments, with a perfect map and all boxes known."""

from __future__ import annotations

import numpy as np

from wherry.domains.delivery import DeliverySite
from wherry.floorplan.plan import FloorPlan
from wherry.floorplan.world_files import parse_world
from wherry.localization.localizer import Localizer
from wherry.localization.parameters import PRECISE_PARAMETERS
from wherry.realization.box_tracks import BoxTrack
from wherry.realization.environment import RobotEnvironment
from wherry.realization.mission import INITIAL_POSE_COVARIANCE
from wherry.realization.pilot import Pilot
from wherry.realization.pose_estimators import MapPoseEstimator
from wherry.realization.pose_tracker import PoseTracker
from wherry.simulation import Simulation, build
from wherry.space.pose import Pose
from wherry.trace.records import null_sink
from wherry_testing.perfect_worlds import centre, frame_of, heading_of, perfect_map

HALL = """\
wherry-world: 1
name: hall

+---+---+---+---+---+---+---+---+
|                   |        ###|
+   +   +   +   +   +   +   +   +
|     >       o     |           |
+   +   +   +   +   +   +   +   +
|                               |
+   +   +   +   +   +   +   +   +
| w   w                         |
+---+---+---+---+---+---+---+---+
"""


def hall(first: str = "o", *, beside: str = " ") -> FloorPlan:
    """The hall, with the robot in cell (1, 2), ``first`` in cell (3, 2) and ``beside`` in cell (4, 2)."""
    return parse_world(HALL.replace("o     |", f"{first}   {beside} |"), source="hall")


def stand_ready(plan: FloorPlan, seed: int = 0) -> tuple[RobotEnvironment, Simulation]:
    """The environment of a robot with noisy sensors and a perfect map, whose frame is the world frame."""
    physics_rng, robot_rng = np.random.default_rng(seed).spawn(2)
    simulation = build(plan, physics_rng)
    grid = perfect_map(plan)
    start = Pose(*centre(plan, plan.start), heading_of(plan))
    localizer = Localizer(grid, simulation.robot.body.lidar, PRECISE_PARAMETERS, robot_rng)
    localizer.initialize(start, INITIAL_POSE_COVARIANCE)
    pilot = Pilot(simulation.robot, PoseTracker(MapPoseEstimator(localizer), start), null_sink)
    boxes = [BoxTrack(number, *box.position, 9, 9) for number, box in enumerate(simulation.referee.boxes)]
    return RobotEnvironment(pilot, frame_of(plan), DeliverySite.of_plan(plan), boxes), simulation
