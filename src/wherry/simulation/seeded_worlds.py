"""Seeded worlds: the same plan, boxes and seed give the same world in a delivery, the ROS simulator and an export."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wherry.errors import InputError
from wherry.floorplan.generation import place_boxes
from wherry.floorplan.plan import FloorPlan


@dataclass(frozen=True, slots=True)
class SeededWorld:
    """A plan with its boxes placed, and the random generators of everything else.

    Attributes:
        plan: The floor plan with its boxes.
        physics_rng: Source of the simulation's randomness, for `build`.
        robot_rng: Source of the robot's own randomness, for localization and learning.
    """

    plan: FloorPlan
    physics_rng: np.random.Generator
    robot_rng: np.random.Generator


def seed_world(plan: FloorPlan, boxes: int | None, seed: int) -> SeededWorld:
    """Place a plan's boxes.

    Args:
        plan: A plan with a robot.
        boxes: Number of boxes to place on random cells; None for the plan's own boxes, or else for its ``box_count``.
        seed: Seed of all randomness.

    Raises:
        InputError: The number is negative, there is not enough space for so many boxes, or boxes are to be placed and
            the plan has no robot.
    """
    if boxes is not None and boxes < 0:
        raise InputError("--boxes", "", f"{boxes} is negative")
    placement_rng, physics_rng, robot_rng = np.random.default_rng(seed).spawn(3)
    if boxes is not None or not plan.boxes:
        plan = place_boxes(plan, plan.box_count if boxes is None else boxes, placement_rng)
    return SeededWorld(plan, physics_rng, robot_rng)
