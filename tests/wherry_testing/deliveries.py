"""Robots on the simulator that stand ready to act, on a perfect map and with the boxes known."""

from __future__ import annotations

import numpy as np

from wherry.domains.delivery import DeliverySite
from wherry.floorplan.plan import FloorPlan
from wherry.floorplan.world_files import parse_world
from wherry.localization.localizer import Localizer
from wherry.localization.parameters import PRECISE_PARAMETERS
from wherry.realization.boxes import Box
from wherry.realization.correctors import MapCorrector
from wherry.realization.environment import RobotEnvironment
from wherry.realization.mission import START_COVARIANCE
from wherry.realization.pilot import Pilot
from wherry.realization.tracking import PoseTracker
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
    """The hall: cells (1, 2) with the robot and (3, 2) with a box; ``beside`` is what stands in (4, 2)."""
    return parse_world(HALL.replace("o     |", f"{first}   {beside} |"), source="hall")


def stand_ready(plan: FloorPlan, seed: int = 0) -> tuple[RobotEnvironment, Simulation]:
    """A robot with noisy sensors on a perfect map, whose frame is the world's."""
    physics, beliefs = np.random.default_rng(seed).spawn(2)
    simulation = build(plan, physics)
    grid = perfect_map(plan)
    start = Pose(*centre(plan, plan.start), heading_of(plan))
    localizer = Localizer(grid, simulation.robot.body.lidar, PRECISE_PARAMETERS, beliefs)
    localizer.initialize(start, START_COVARIANCE)
    pilot = Pilot(simulation.robot, PoseTracker(MapCorrector(localizer), start), null_sink)
    boxes = [Box(number, *box.position, 9, 9) for number, box in enumerate(simulation.referee.boxes)]
    return RobotEnvironment(pilot, frame_of(plan), DeliverySite.of_plan(plan), boxes), simulation
