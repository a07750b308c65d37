"""Worlds with seeded boxes and random generators, shared by deliveries, the ROS simulator and Gazebo exports."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wherry.errors import InputError
from wherry.floorplan.generation import place_boxes
from wherry.floorplan.plan import FloorPlan


@dataclass(frozen=True, slots=True)
class SeededWorld:
    """A plan with its boxes placed, and the random generators of a run in it.

    Attributes:
        plan: The floor plan with its boxes.
        physics_rng: Source of the simulation's randomness, for `build`.
        robot_rng: Source of the robot's own randomness, for localization and learning.
    """

    plan: FloorPlan
    physics_rng: np.random.Generator
    robot_rng: np.random.Generator


def seed_world(plan: FloorPlan, boxes: int | None, seed: int) -> SeededWorld:
    """Place a plan's boxes and spawn the random generators; equal arguments give equal worlds.

    Args:
        plan: A plan with a robot.
        boxes: Number of boxes to place in random cells; None to keep the plan's boxes, or to place its ``box_count`` if
            it has none.
        seed: Seed of all randomness.

    Raises:
        InputError: The number of boxes is negative or too large for the plan, or boxes have to be placed in a plan
            without a robot.
    """
    if boxes is not None and boxes < 0:
        raise InputError("--boxes", "", f"{boxes} is negative")
    placement_rng, physics_rng, robot_rng = np.random.default_rng(seed).spawn(3)
    if boxes is not None or not plan.boxes:
        plan = place_boxes(plan, plan.box_count if boxes is None else boxes, placement_rng)
    return SeededWorld(plan, physics_rng, robot_rng)
