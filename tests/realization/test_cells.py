"""Floor plans from maps, and touch relations from scans, compared with the true plan in every cell."""

from __future__ import annotations

import math

import numpy as np
import pytest

from wherry.floorplan.plan import Cell, Direction, FloorPlan
from wherry.floorplan.world_files import built_in_worlds, find_world
from wherry.realization.cells import blocked_directions, floor_plan_from_map, occupied_cells
from wherry.realization.load import mask_load
from wherry.simulation.model import BODY
from wherry.space.frame import CellFrame, fit_cell_frame
from wherry.space.occupancy import UNKNOWN, OccupancyGrid
from wherry.space.pose import IDENTITY, Pose
from wherry_testing.perfect_worlds import MovableLidar, centre, frame_of, perfect_map

NO_BOXES = np.empty((0, 2))
ROOMS = find_world("rooms").with_boxes(())
POSES = [IDENTITY, Pose(0.313, -1.117, 0.0), Pose(-4.2, 2.9, 0.4), Pose(1.0, 7.7, -0.7), Pose(0.3, 0.2, 2.0)]


def nearest_direction(heading: float, frame: CellFrame) -> Direction:
    """The direction of the cell grid nearest to a heading, rad, map frame."""
    return min(Direction, key=lambda d: abs(math.remainder(frame.heading(d.dx, d.dy) - heading, math.tau)))


def cell_in(frame: CellFrame, map_from_world: Pose, plan: FloorPlan, cell: Cell) -> Cell:
    """A cell of the plan as a cell of the frame."""
    x, y = map_from_world.transform(centre(plan, cell)[None, :])[0]
    return Cell(*frame.cell_at(x, y))


def assert_same_passages(discretized: FloorPlan, frame: CellFrame, plan: FloorPlan, map_from_world: Pose) -> None:
    """Assert that both plans have the same open cells and passages, up to the frame's rotation."""
    rotated = {
        direction: nearest_direction(map_from_world.theta + math.atan2(direction.dy, direction.dx), frame)
        for direction in Direction
    }
    names = {cell: cell_in(frame, map_from_world, plan, cell) for cell in plan.cells()}
    assert set(discretized.cells()) == set(names.values())
    differing = [
        (cell, direction)
        for cell, name in names.items()
        for direction in Direction
        if discretized.is_blocked(name, rotated[direction]) != plan.is_blocked(cell, direction)
    ]
    assert differing == []


@pytest.mark.parametrize("name", built_in_worlds())
@pytest.mark.parametrize("pose", POSES)
def test_a_perfect_map_gives_the_true_cells_and_walls(name: str, pose: Pose) -> None:
    plan = find_world(name)
    grid = perfect_map(plan, pose)
    frame = fit_cell_frame(grid.occupied_points(), plan.cell_size)
    assert_same_passages(floor_plan_from_map(grid, frame, BODY.radius), frame, plan, pose)


@pytest.mark.parametrize("resolution", [0.025, 0.05])
def test_an_exact_frame_gives_the_same_plan(resolution: float) -> None:
    discretized = floor_plan_from_map(perfect_map(ROOMS, resolution=resolution), frame_of(ROOMS), BODY.radius, "read")
    assert discretized.name == "read"
    assert discretized.cell_size == ROOMS.cell_size
    assert (discretized.boxes, discretized.warehouse, discretized.start) == ((), frozenset(), None)
    assert_same_passages(discretized, frame_of(ROOMS), ROOMS, IDENTITY)


def test_an_unknown_cell_is_not_open() -> None:
    grid = perfect_map(ROOMS)
    probability = grid.probability.copy()
    rows, columns = grid.cells_at(centre(ROOMS, Cell(2, 2))[None, :]).T
    probability[rows[0] - 5 : rows[0] + 6, columns[0] - 5 : columns[0] + 6] = UNKNOWN
    discretized = floor_plan_from_map(
        OccupancyGrid(probability, grid.resolution, grid.origin), frame_of(ROOMS), BODY.radius
    )
    assert ROOMS.is_open(Cell(2, 2))
    assert not discretized.is_open(Cell(2, 2))


def test_an_unknown_map_has_no_open_cells() -> None:
    grid = OccupancyGrid(np.full((40, 40), UNKNOWN, np.float32), 0.05)
    assert list(floor_plan_from_map(grid, CellFrame(IDENTITY, 0.6), BODY.radius).cells()) == []


def test_occupied_cells_are_those_occupied_at_the_centre() -> None:
    grid = perfect_map(ROOMS)
    assert occupied_cells(grid, frame_of(ROOMS), ROOMS) == ROOMS.obstacles
    row, column = grid.cells_at(centre(ROOMS, Cell(2, 2))[None, :])[0]
    grid.probability[row, column] = 1.0
    assert occupied_cells(grid, frame_of(ROOMS), ROOMS) == ROOMS.obstacles | {Cell(2, 2)}


@pytest.mark.parametrize("heading", [-math.pi / 2, 0.0, math.pi / 2, math.pi])
@pytest.mark.parametrize("with_box", [False, True], ids=["empty fork", "box in the fork"])
def test_an_exact_scan_shows_the_blocked_directions_of_every_cell(heading: float, with_box: bool) -> None:
    lidar, frame = MovableLidar(ROOMS), frame_of(ROOMS)
    cells = sorted(ROOMS.distances(ROOMS.start))
    missing = 0
    for cell in cells:
        x, y = centre(ROOMS, cell)
        pose = Pose(x, y, heading)
        scan = mask_load(lidar.scan(pose, centre(ROOMS, cell) if with_box else None), BODY)
        blocked = blocked_directions(scan, pose @ BODY.lidar, cell, frame, BODY.radius, NO_BOXES, BODY.box_radius)
        assert blocked == {direction: ROOMS.is_blocked(cell, direction) for direction in blocked}, cell
        missing += len(Direction) - len(blocked)
    # Only the direction behind a box in the fork may be unobserved.
    assert missing <= (len(cells) if with_box else 0)


@pytest.mark.parametrize("with_box", [False, True], ids=["empty fork", "box in the fork"])
def test_blocked_directions_are_robust_to_noise_and_pose_errors(with_box: bool) -> None:
    lidar, frame, rng = MovableLidar(ROOMS, noise=0.01), frame_of(ROOMS), np.random.default_rng(11)
    observed = wrong = 0
    for cell in sorted(ROOMS.distances(ROOMS.start)):
        x, y = centre(ROOMS, cell) + rng.uniform(-0.02, 0.02, 2)
        pose = Pose(x, y, rng.choice([0.0, 0.5, 1.0, -0.5]) * math.pi + rng.uniform(-0.02, 0.02))
        scan = mask_load(lidar.scan(pose, np.array([x, y]) if with_box else None), BODY)
        estimated = Pose(x + rng.uniform(-0.01, 0.01), y + rng.uniform(-0.01, 0.01), pose.theta)
        blocked = blocked_directions(scan, estimated @ BODY.lidar, cell, frame, BODY.radius, NO_BOXES, BODY.box_radius)
        observed += len(blocked)
        wrong += sum(is_blocked != ROOMS.is_blocked(cell, direction) for direction, is_blocked in blocked.items())
    assert observed > 800
    assert wrong == 0


def test_a_known_box_in_the_next_cell_is_not_a_wall() -> None:
    plan, cell = find_world("small").with_boxes(()), Cell(2, 3)
    assert not any(plan.is_blocked(cell, direction) for direction in Direction)
    lidar, frame = MovableLidar(plan), frame_of(plan)
    pose = Pose(*centre(plan, cell), 0.0)
    boxes = np.array([centre(plan, cell.neighbour(Direction.NORTH))])
    scan = lidar.scan(pose, boxes)
    with_boxes = blocked_directions(scan, pose @ BODY.lidar, cell, frame, BODY.radius, boxes, BODY.box_radius)
    without_boxes = blocked_directions(scan, pose @ BODY.lidar, cell, frame, BODY.radius, NO_BOXES, BODY.box_radius)
    assert True not in with_boxes.values()
    assert without_boxes[Direction.NORTH] is True


def test_a_scan_without_returns_shows_no_direction() -> None:
    lidar = MovableLidar(ROOMS)
    pose = Pose(*centre(ROOMS, ROOMS.start), 0.0)
    scan = lidar.scan(pose)
    scan.ranges[:] = math.nan
    assert blocked_directions(scan, pose, ROOMS.start, frame_of(ROOMS), BODY.radius, NO_BOXES, BODY.box_radius) == {}
