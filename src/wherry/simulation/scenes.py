"""The same world for the same plan, boxes and seed, whoever asks: a delivery, the simulator for ROS, an export."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wherry.errors import InputError
from wherry.floorplan.generation import place_boxes
from wherry.floorplan.plan import FloorPlan


@dataclass(frozen=True, slots=True)
class Scene:
    """A plan with its boxes placed, and where all further randomness comes from.

    Attributes:
        plan: The floor plan.
        physics: For `build`.
        beliefs: For the robot's mind.
    """

    plan: FloorPlan
    physics: np.random.Generator
    beliefs: np.random.Generator


def choose_scene(plan: FloorPlan, boxes: int | None, seed: int) -> Scene:
    """Place a plan's boxes.

    Args:
        plan: With a robot.
        boxes: How many, on random cells; None for what the plan says: its own ones, or its ``box_count``.
        seed: Of everything that is random.

    Raises:
        InputError: The number is negative, there is no room for so many, or boxes are to be placed and there is no
            robot.
    """
    if boxes is not None and boxes < 0:
        raise InputError("--boxes", "", f"{boxes} is negative")
    places, physics, beliefs = np.random.default_rng(seed).spawn(3)
    if boxes is not None or not plan.boxes:
        plan = place_boxes(plan, plan.box_count if boxes is None else boxes, places)
    return Scene(plan, physics, beliefs)
