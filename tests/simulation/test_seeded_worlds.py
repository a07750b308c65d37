"""Seeded worlds: box placement and random generators."""

from __future__ import annotations

import numpy as np
import pytest

from wherry.errors import InputError
from wherry.floorplan.generation import place_boxes
from wherry.floorplan.plan import Cell
from wherry.floorplan.world_files import find_world
from wherry.simulation.seeded_worlds import seed_world


def test_the_same_seed_gives_the_same_world_and_another_seed_another() -> None:
    plan = find_world("rooms")
    one, same, other = (seed_world(plan, 4, seed) for seed in (3, 3, 4))
    assert one.plan == same.plan == place_boxes(plan, 4, np.random.default_rng(3).spawn(1)[0])
    assert one.plan != other.plan
    assert one.physics_rng.random() == same.physics_rng.random() != other.physics_rng.random()
    assert one.robot_rng.random() == same.robot_rng.random() != one.physics_rng.random()


def test_a_plans_boxes_are_kept_unless_a_number_is_given() -> None:
    plan = find_world("rooms").with_boxes([Cell(0, 0)])
    assert seed_world(plan, None, 0).plan == plan
    assert seed_world(plan, 0, 0).plan.boxes == ()
    assert len(seed_world(plan.with_boxes([]), None, 0).plan.boxes) == plan.box_count > 0


def test_a_negative_number_of_boxes_is_rejected() -> None:
    with pytest.raises(InputError, match="--boxes: -1 is negative"):
        seed_world(find_world("rooms"), -1, 0)
