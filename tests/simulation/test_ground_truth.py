"""The true map of a world, and random poses in it."""

from __future__ import annotations

import numpy as np

from wherry.floorplan.generation import place_boxes
from wherry.floorplan.world_files import find_world
from wherry.simulation.faults import cell_pose, random_cell_pose, reachable_cells
from wherry.simulation.ground_truth import true_map


def test_true_map_is_free_in_every_reachable_cell() -> None:
    plan = find_world("small")
    grid = true_map(plan)
    centres = np.array([cell_pose(plan, cell, 0.0).as_array()[:2] for cell in reachable_cells(plan)])
    rows, columns = grid.cells_at(centres).T
    assert grid.free[rows, columns].all()
    assert grid.occupied.any()


def test_true_map_does_not_depend_on_the_boxes() -> None:
    plan = find_world("small")
    with_boxes = place_boxes(plan, 2, np.random.default_rng(3))
    np.testing.assert_array_equal(true_map(with_boxes).probability, true_map(plan.with_boxes(())).probability)


def test_random_cell_poses_are_reachable_and_without_a_box() -> None:
    plan = place_boxes(find_world("small"), 2, np.random.default_rng(0))
    allowed = {cell for cell in reachable_cells(plan) if cell not in plan.boxes}
    centres = {(pose.x, pose.y) for pose in (cell_pose(plan, cell, 0.0) for cell in allowed)}
    rng = np.random.default_rng(1)
    drawn = [random_cell_pose(plan, rng) for _ in range(50)]
    assert all((pose.x, pose.y) in centres for pose in drawn)
