"""Surveys of a mission: map, cells, boxes and warehouse are compared with the ground truth."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from wherry.floorplan.generation import place_boxes
from wherry.floorplan.plan import Cell, Direction, FloorPlan
from wherry.floorplan.world_files import find_world
from wherry.realization.mission import Mission, SurveyedWorld, order_from_plan
from wherry.simulation import Simulation, build
from wherry.space.map_files import load_map, save_map
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose
from wherry.trace.records import MapUpdate, Narration, Record, RobotSnapshot
from wherry_testing.perfect_worlds import centre, heading_of, perfect_map


@dataclass(frozen=True)
class FinishedSurvey:
    """A finished survey and its simulation."""

    plan: FloorPlan
    simulation: Simulation
    surveyed: SurveyedWorld
    records: tuple[Record, ...]

    @property
    def world_from_map(self) -> Pose:
        """The map frame, which is base_link at the start, in the world frame."""
        return Pose(*centre(self.plan, self.plan.start), heading_of(self.plan))

    def true_cell(self, cell: Cell) -> Cell:
        """A cell of the robot's frame as a cell of the plan."""
        x, y = self.world_from_map.transform(self.surveyed.frame.centre(cell.x, cell.y)[None, :])[0]
        return Cell(math.floor(x / self.plan.cell_size), math.floor(y / self.plan.cell_size))


def with_boxes(name: str) -> FloorPlan:
    plan = find_world(name)
    return plan if plan.boxes else place_boxes(plan, plan.box_count, np.random.default_rng(0))


def start(plan: FloorPlan, grid: OccupancyGrid | None = None) -> FinishedSurvey:
    """Run a survey: by exploration, or by localization on a given map."""
    simulation, records = build(plan, np.random.default_rng(1)), []
    mission = Mission(simulation.robot, order_from_plan(plan), records.append, np.random.default_rng(2))
    surveyed = mission.explore() if grid is None else mission.localize(grid)
    return FinishedSurvey(plan, simulation, surveyed, tuple(records))


@pytest.fixture(scope="module", params=["small", "taxi"])
def survey(request: pytest.FixtureRequest) -> FinishedSurvey:
    return start(with_boxes(request.param))


def test_walls_on_the_map_are_accurate_to_two_centimetres(survey: FinishedSurvey) -> None:
    points = survey.world_from_map.transform(survey.surveyed.grid.occupied_points())
    errors = survey.simulation.referee.wall_distance(points)
    assert np.median(errors) < 0.02
    assert np.quantile(errors, 0.95) < 0.08


def test_the_map_has_the_true_cells_and_walls(survey: FinishedSurvey) -> None:
    plan, surveyed_plan = survey.plan, survey.surveyed.plan
    reachable = surveyed_plan.distances(survey.surveyed.environment.cell)
    map_cells = {survey.true_cell(cell): cell for cell in reachable}
    assert set(map_cells) == set(plan.distances(plan.start))
    for cell, map_cell in map_cells.items():
        for direction in Direction:
            neighbour = cell.neighbour(direction)
            if neighbour in map_cells:
                map_direction = next(d for d in Direction if map_cell.neighbour(d) == map_cells[neighbour])
                is_blocked = surveyed_plan.is_blocked(map_cell, map_direction)
                assert is_blocked == plan.is_blocked(cell, direction), (cell, direction)


def test_every_box_is_found_in_its_true_cell(survey: FinishedSurvey) -> None:
    state = survey.surveyed.environment.reset(np.random.default_rng(0))
    found = {survey.true_cell(Cell(box.x, box.y)) for box in state.of_class("Box")}
    assert found == set(survey.plan.boxes)
    assert survey.surveyed.environment.remaining == len(survey.plan.boxes)


def test_the_warehouse_is_in_its_true_cells(survey: FinishedSurvey) -> None:
    warehouse = {survey.true_cell(cell) for cell in survey.surveyed.environment.site.warehouse}
    assert warehouse == survey.plan.warehouse


def test_the_robot_stands_in_the_centre_of_a_cell_without_collisions(survey: FinishedSurvey) -> None:
    pose = survey.simulation.referee.pose
    cell = survey.true_cell(survey.surveyed.environment.cell)
    assert math.dist((pose.x, pose.y), centre(survey.plan, cell)) < 0.06
    assert survey.simulation.referee.collisions == []


def test_every_published_box_is_a_true_box(survey: FinishedSurvey) -> None:
    true = survey.world_from_map.inverse.transform(np.array([centre(survey.plan, cell) for cell in survey.plan.boxes]))
    shown = [record.boxes for record in survey.records if isinstance(record, RobotSnapshot)]
    assert len(shown[-1]) == len(true)
    for place in np.vstack(shown):
        assert np.hypot(*(true - place).T).min() < 0.15


def test_the_particle_filter_starts_once_after_mapping(survey: FinishedSurvey) -> None:
    # SLAM estimates the pose until the survey is finished, and the particle filter afterwards.
    by_particles = [len(record.particles) > 0 for record in survey.records if isinstance(record, RobotSnapshot)]
    assert by_particles == sorted(by_particles)


def test_records_report_phase_and_progress_in_order_of_time(survey: FinishedSurvey) -> None:
    assert next(record.phase for record in survey.records if isinstance(record, Narration)) == "explore"
    explored = [record for record in survey.records if isinstance(record, MapUpdate)]
    assert explored[-1].explored_fraction == 1.0
    assert explored[0].explored_fraction < 0.9
    times = [record.time for record in survey.records]
    assert times == sorted(times)
    localized = [record for record in survey.records if isinstance(record, RobotSnapshot) and len(record.particles)]
    assert localized


@pytest.mark.parametrize("name", ["small", pytest.param("rooms", marks=pytest.mark.slow)])
def test_a_robot_with_a_map_localizes_itself_and_finds_the_boxes(name: str, tmp_path: Path) -> None:
    plan = with_boxes(name)
    map_from_world = Pose(2.0, -1.0, 0.2)
    path = save_map(perfect_map(plan, map_from_world), tmp_path / "map.yaml")
    survey = start(plan, load_map(path))
    found = survey.surveyed.environment.pilot.pose
    true = survey.simulation.referee.pose
    in_map = map_from_world.transform(np.array([[true.x, true.y]]))[0]
    assert math.dist((found.x, found.y), in_map) < 0.08
    world = map_from_world.inverse.transform

    def cells(points: Floats) -> set[Cell]:
        return {Cell(*(int(part) for part in row)) for row in np.floor(world(points) / plan.cell_size)}

    environment, frame = survey.surveyed.environment, survey.surveyed.frame
    centres = np.array([frame.centre(cell.x, cell.y) for cell in environment.site.warehouse])
    assert cells(centres) == plan.warehouse
    boxes = environment.reset(np.random.default_rng(0)).of_class("Box")
    assert cells(np.array([frame.centre(box.x, box.y) for box in boxes])) == set(plan.boxes)
    assert survey.simulation.referee.collisions == []


def test_the_same_seed_gives_the_same_map() -> None:
    grids = [start(with_boxes("taxi")).surveyed.grid.probability for _ in range(2)]
    np.testing.assert_array_equal(*grids)
