"""From being switched on to standing ready: the map, the boxes and the warehouse are what they truly are."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from wherry.floorplan.generation import place_boxes
from wherry.floorplan.plan import Cell, Direction, FloorPlan
from wherry.floorplan.world_files import find_world
from wherry.pipelines.delivery.simulated import order_of
from wherry.realization.mission import Mission, Ready
from wherry.simulation import Simulation, build
from wherry.space.map_files import load_map, save_map
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose
from wherry.trace.records import MapUpdate, Narration, Record, RobotSnapshot
from wherry_testing.perfect_worlds import centre, heading_of, perfect_map


@dataclass(frozen=True)
class Explorer:
    """A mission that is over."""

    plan: FloorPlan
    simulation: Simulation
    ready: Ready
    records: tuple[Record, ...]

    @property
    def world_from_map(self) -> Pose:
        """The map's frame is where the robot was switched on."""
        return Pose(*centre(self.plan, self.plan.start), heading_of(self.plan))

    def true_cell(self, cell: Cell) -> Cell:
        """A cell of the robot's frame as a cell of the plan."""
        x, y = self.world_from_map.transform(self.ready.frame.centre(cell.x, cell.y)[None, :])[0]
        return Cell(math.floor(x / self.plan.cell_size), math.floor(y / self.plan.cell_size))


def with_boxes(name: str) -> FloorPlan:
    plan = find_world(name)
    return plan if plan.boxes else place_boxes(plan, plan.box_count, np.random.default_rng(0))


def start(plan: FloorPlan, grid: OccupancyGrid | None = None) -> Explorer:
    """Switch a robot on; with a map, it has to find itself on it."""
    simulation, records = build(plan, np.random.default_rng(1)), []
    mission = Mission(simulation.robot, order_of(plan), records.append, np.random.default_rng(2))
    ready = mission.explore() if grid is None else mission.find_itself(grid)
    return Explorer(plan, simulation, ready, tuple(records))


@pytest.fixture(scope="module", params=["small", "taxi"])
def explorer(request: pytest.FixtureRequest) -> Explorer:
    return start(with_boxes(request.param))


def test_the_map_shows_the_walls_to_two_centimetres(explorer: Explorer) -> None:
    points = explorer.world_from_map.transform(explorer.ready.grid.occupied_points())
    errors = explorer.simulation.referee.wall_distance(points)
    assert np.median(errors) < 0.02
    assert np.quantile(errors, 0.95) < 0.08


def test_every_cell_and_every_wall_is_found(explorer: Explorer) -> None:
    plan, read = explorer.plan, explorer.ready.plan
    reached = set(read.distances(explorer.ready.environment.cell))
    true = {explorer.true_cell(cell): cell for cell in reached}
    assert set(true) == set(plan.distances(plan.start))
    neighbours = {
        (cell, other) for cell in true for other in true if abs(cell.x - other.x) + abs(cell.y - other.y) == 1
    }
    for cell, other in neighbours:
        a, b = true[cell], true[other]
        mine = next(way for way in Direction if a.neighbour(way) == b)
        theirs = next(way for way in Direction if cell.neighbour(way) == other)
        assert read.is_blocked(a, mine) == plan.is_blocked(cell, theirs), (cell, other)


def test_every_box_is_found_where_it_stands(explorer: Explorer) -> None:
    state = explorer.ready.environment.reset(np.random.default_rng(0))
    found = {explorer.true_cell(Cell(box.x, box.y)) for box in state.of_class("Box")}
    assert found == set(explorer.plan.boxes)
    assert explorer.ready.environment.remaining == len(explorer.plan.boxes)


def test_the_warehouse_is_where_the_order_says(explorer: Explorer) -> None:
    warehouse = {explorer.true_cell(cell) for cell in explorer.ready.environment.site.warehouse}
    assert warehouse == explorer.plan.warehouse


def test_it_stands_in_the_middle_of_a_cell_and_has_touched_nothing(explorer: Explorer) -> None:
    pose = explorer.simulation.referee.pose
    cell = explorer.true_cell(explorer.ready.environment.cell)
    assert math.dist((pose.x, pose.y), centre(explorer.plan, cell)) < 0.06
    assert explorer.simulation.referee.collisions == []


def test_whatever_is_shown_as_a_box_is_one(explorer: Explorer) -> None:
    true = explorer.world_from_map.inverse.transform(
        np.array([centre(explorer.plan, cell) for cell in explorer.plan.boxes])
    )
    shown = [record.boxes for record in explorer.records if isinstance(record, RobotSnapshot)]
    assert len(shown[-1]) == len(true)
    for place in np.vstack(shown):
        assert np.hypot(*(true - place).T).min() < 0.15


def test_the_robot_is_localized_once(explorer: Explorer) -> None:
    # SLAM keeps the pose until everything is seen, the particle filter from then on: none is started in between.
    by_particles = [len(record.particles) > 0 for record in explorer.records if isinstance(record, RobotSnapshot)]
    assert by_particles == sorted(by_particles)


def test_it_says_what_it_does(explorer: Explorer) -> None:
    assert next(record.phase for record in explorer.records if isinstance(record, Narration)) == "explore"
    explored = [record for record in explorer.records if isinstance(record, MapUpdate)]
    assert explored[-1].explored_fraction == 1.0
    assert explored[0].explored_fraction < 0.9
    times = [record.time for record in explorer.records]
    assert times == sorted(times)
    localized = [record for record in explorer.records if isinstance(record, RobotSnapshot) and len(record.particles)]
    assert localized


@pytest.mark.parametrize("name", ["small", pytest.param("rooms", marks=pytest.mark.slow)])
def test_a_robot_with_a_map_finds_itself_and_the_boxes(name: str, tmp_path: Path) -> None:
    plan = with_boxes(name)
    map_from_world = Pose(2.0, -1.0, 0.2)
    path = save_map(perfect_map(plan, map_from_world), tmp_path / "map.yaml")
    explorer = start(plan, load_map(path))
    found = explorer.ready.environment.pilot.pose
    true = explorer.simulation.referee.pose
    in_map = map_from_world.transform(np.array([[true.x, true.y]]))[0]
    assert math.dist((found.x, found.y), in_map) < 0.08
    world = map_from_world.inverse.transform

    def cells(points: Floats) -> set[Cell]:
        return {Cell(*(int(part) for part in row)) for row in np.floor(world(points) / plan.cell_size)}

    environment, frame = explorer.ready.environment, explorer.ready.frame
    middles = np.array([frame.centre(cell.x, cell.y) for cell in environment.site.warehouse])
    assert cells(middles) == plan.warehouse
    boxes = environment.reset(np.random.default_rng(0)).of_class("Box")
    assert cells(np.array([frame.centre(box.x, box.y) for box in boxes])) == set(plan.boxes)
    assert explorer.simulation.referee.collisions == []


def test_the_same_seed_gives_the_same_map() -> None:
    grids = [start(with_boxes("taxi")).ready.grid.probability for _ in range(2)]
    np.testing.assert_array_equal(*grids)
