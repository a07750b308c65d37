"""Finding boxes: exact scans first, then with seeded noise; and what is round but no box."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from wherry.floorplan.plan import Cell, FloorPlan, Wall
from wherry.floorplan.world_files import find_world, parse_world
from wherry.realization.boxes import (
    FEWEST_SIGHTINGS,
    Box,
    look_for_boxes,
    round_things,
    standing_alone,
    standing_free,
    without_boxes,
)
from wherry.realization.cells import plan_of_map
from wherry.robot import Scan
from wherry.simulation.model import BODY
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose
from wherry_testing.perfect_worlds import MovableLidar, centre, frame_of, perfect_map

RADIUS = BODY.box_radius
HALL = parse_world(
    "wherry-world: 1\nname: hall\n\n"
    + "+---+---+---+---+---+---+---+---+\n"
    + "|   |                        ###|\n"
    + "+   +   +   +   +   +   +   +   +\n"
    + "|   |                           |\n"
    + "+   +   +---+---+   +---+---+   +\n"
    + "|     >                         |\n"
    + "+   +   +   +   +   +   +   +   +\n"
    + "| w                             |\n"
    + "+---+---+---+---+---+---+---+---+\n",
    source="hall",
)
EXACT, NOISY = MovableLidar(HALL), MovableLidar(HALL, noise=0.01)
PLACES = [(2.1, 0.35), (2.4, 0.9), (1.9, 0.3), (2.9, 0.6), (0.3, 0.9)]
HEADINGS = [0.0, 1.0, 2.5, -2.0]


def found(eye: MovableLidar, base: Pose, boxes: Floats) -> Floats:
    """[K, 2] m, world frame."""
    return (base @ BODY.lidar).transform(round_things(eye.scan(base, boxes), RADIUS))


@pytest.mark.parametrize("heading", HEADINGS)
@pytest.mark.parametrize("place", PLACES)
def test_an_exact_scan_gives_a_box_to_a_millimetre(place: tuple[float, float], heading: float) -> None:
    middles = found(EXACT, Pose(1.2, 0.9, heading), np.array([place]))
    assert middles.shape == (1, 2)
    np.testing.assert_allclose(middles[0], place, atol=0.001)


@pytest.mark.parametrize("place", PLACES)
def test_a_noisy_scan_gives_a_box_to_one_and_a_half_centimetres(place: tuple[float, float]) -> None:
    errors = []
    for heading in np.linspace(-3.0, 3.0, 20):
        middles = found(NOISY, Pose(1.2, 0.9, heading), np.array([place]))
        errors += np.hypot(*(middles - place).T).tolist()
    assert len(errors) >= 12  # noise at the rim hides one now and then
    assert np.median(errors) < 0.007
    assert np.quantile(errors, 0.95) < 0.015


def test_several_boxes_are_told_apart() -> None:
    boxes = np.array([(2.1, 0.35), (2.4, 0.9), (0.3, 0.9)])
    middles = found(EXACT, Pose(1.2, 0.9, 0.4), boxes)
    assert len(middles) == 3
    np.testing.assert_allclose(middles[np.argsort(middles[:, 0])], boxes[np.argsort(boxes[:, 0])], atol=0.001)


def test_a_box_that_beam_0_hits_is_found_whole() -> None:
    # Beam 0 looks backwards: the run of beams on this box goes on from the last one to the first.
    base = Pose(1.8, 0.9, 0.0)
    behind = np.array([[base.x - 1.0, base.y]])
    scan = EXACT.scan(base, behind)
    assert scan.ranges[0] < 1.0
    assert scan.ranges[-1] < 1.0
    np.testing.assert_allclose(found(EXACT, base, behind), behind, atol=0.001)


@pytest.mark.parametrize("name", ["small", "rooms", "taxi", "taxi10"])
def test_walls_jambs_and_obstacles_seldom_look_round_and_never_become_boxes(name: str) -> None:
    plan = find_world(name)
    plan = plan.with_boxes(())
    eye, rng = MovableLidar(plan, noise=0.01), np.random.default_rng(1)
    grid = perfect_map(plan)
    boxes: tuple[Box, ...] = ()
    cells = sorted(plan.cells())[:: max(1, len(list(plan.cells())) // 60)]
    for cell in cells:
        for _ in range(4):
            x, y = centre(plan, cell)
            pose = Pose(x, y, rng.uniform(-math.pi, math.pi))
            boxes = look_for_boxes(boxes, eye.scan(pose), pose, BODY)
    assert standing_free(boxes, grid, RADIUS) == ()


def test_what_is_flat_in_full_view_is_no_box_for_long() -> None:
    """A wall's end may look round in passing; each look from where a box would surely look round counts against it."""
    end = Box(0, 1.2, 1.5, FEWEST_SIGHTINGS, FEWEST_SIGHTINGS)
    before, far = Pose(1.0, 0.6, 0.0), Pose(3.6, 0.4, 0.0)
    assert end.certain
    (unseen,) = look_for_boxes([end], EXACT.scan(far, np.empty((0, 2))), far, BODY)
    assert unseen == end, "too far away to tell"
    hidden = EXACT.scan(before, np.array([[1.1, 1.05]]))
    assert look_for_boxes([end], hidden, before, BODY)[0] == end, "behind a box"
    boxes: tuple[Box, ...] = (end,)
    for _ in range(FEWEST_SIGHTINGS + 1):
        boxes = look_for_boxes(boxes, EXACT.scan(before, np.empty((0, 2))), before, BODY)
    assert not boxes[0].certain


@pytest.mark.parametrize("place", PLACES)
def test_a_box_in_full_view_is_not_overlooked(place: tuple[float, float]) -> None:
    eye, boxes = MovableLidar(HALL, noise=0.01), tuple[Box, ...]()
    for heading in np.linspace(-3.0, 3.0, 60):
        pose = Pose(1.2, 0.9, heading)
        boxes = look_for_boxes(boxes, eye.scan(pose, np.array([place])), pose, BODY)
    (box,) = (box for box in boxes if math.hypot(box.x - place[0], box.y - place[1]) < 0.05)
    assert box.sightings >= 0.8 * box.looks


def test_in_an_empty_hall_only_a_walls_end_may_look_round_and_from_few_places() -> None:
    grid = perfect_map(HALL)
    seen = []
    for cell in HALL.cells():
        x, y = centre(HALL, cell)
        seen += found(EXACT, Pose(x, y, 0.3), np.empty((0, 2))).tolist()
    assert len(seen) <= 1
    alleged = [Box(number, x, y, 99, 99) for number, (x, y) in enumerate(seen)]
    assert standing_free(alleged, grid, RADIUS) == ()


def test_a_scan_without_a_single_reading_shows_nothing() -> None:
    for value in (math.nan, math.inf):
        scan = Scan(0.0, np.full(360, value), -math.pi, math.tau / 360, 0.02, 12.0)
        assert round_things(scan, RADIUS).shape == (0, 2)


def test_too_far_a_box_is_not_guessed_at() -> None:
    base = Pose(0.9, 0.9, 0.0)
    assert found(EXACT, base, np.array([[4.3, 0.5]])).shape == (0, 2)


def looks(eye: MovableLidar, base: Pose, boxes: Floats, times: int, before: tuple[Box, ...] = ()) -> tuple[Box, ...]:
    """What is believed after some scans."""
    for _ in range(times):
        before = look_for_boxes(before, eye.scan(base, boxes), base, BODY)
    return before


def test_a_box_is_believed_after_several_sightings_and_keeps_its_number() -> None:
    base, place = Pose(1.2, 0.9, 0.2), np.array([[2.4, 0.9]])
    few = looks(NOISY, base, place, FEWEST_SIGHTINGS - 1)
    assert [box.certain for box in few] == [False]
    (box,) = looks(NOISY, base, place, 1, few)
    assert box.certain
    assert box.number == few[0].number == 0
    (box,) = looks(NOISY, base, place, 30, (box,))
    assert math.hypot(box.x - 2.4, box.y - 0.9) < 0.008
    both = looks(NOISY, base, np.array([[2.4, 0.9], [0.3, 0.9]]), 1, (box,))
    assert [box.number for box in both] == [0, 1]


def test_a_place_seen_empty_counts_against_a_box() -> None:
    base, place = Pose(1.2, 0.9, 0.2), np.array([[2.4, 0.9]])
    (box,) = looks(EXACT, base, place, FEWEST_SIGHTINGS)
    (gone,) = looks(EXACT, base, np.empty((0, 2)), FEWEST_SIGHTINGS + 1, (box,))
    assert (gone.sightings, gone.looks) == (FEWEST_SIGHTINGS, 2 * FEWEST_SIGHTINGS + 1)
    assert not gone.certain


def test_a_box_behind_another_is_neither_seen_nor_doubted() -> None:
    base = Pose(1.0, 0.9, 0.0)
    (box,) = looks(EXACT, base, np.array([[2.6, 0.9]]), FEWEST_SIGHTINGS)
    after = looks(EXACT, base, np.array([[2.6, 0.9], [1.8, 0.9]]), 3, (box,))
    assert after[0] == box
    assert after[1].certain is False


@pytest.mark.parametrize("theta", [0.0, 0.5])
def test_what_stands_free_is_a_box_and_what_goes_on_is_not(theta: float) -> None:
    map_from_world = Pose(3.0, -1.0, theta)
    grid = perfect_map(HALL, map_from_world)
    free, jamb = (1.5, 0.9), (1.2, 1.2)  # in the middle of a cell; at the end of a wall
    boxes = [
        Box(number, *map_from_world.transform(np.array([place]))[0].tolist(), FEWEST_SIGHTINGS, FEWEST_SIGHTINGS)
        for number, place in enumerate((free, jamb))
    ]
    assert standing_free(boxes, grid, RADIUS) == (boxes[0],)
    assert standing_free([replace(boxes[0], sightings=1)], grid, RADIUS) == ()


def near_a_wall(gap: float) -> tuple[OccupancyGrid, Box]:
    """A box on the map at a distance, m, from the face of a wall, which is a grid cell's edge; both are seen whole."""
    probability = np.zeros((40, 40), np.float32)
    probability[:10] = 1.0
    grid = OccupancyGrid(probability, 0.05)
    box = Box(0, 1.0, 0.5 + gap, FEWEST_SIGHTINGS, FEWEST_SIGHTINGS)
    cells = np.argwhere(np.ones((40, 40), np.bool_))
    rim = np.abs(np.hypot(*(grid.centres(cells) - (box.x, box.y)).T) - RADIUS) < 0.03
    probability.reshape(-1)[rim] = 1.0
    return OccupancyGrid(probability, 0.05), box


@pytest.mark.parametrize("gap", [0.30, 0.26, 0.23])
def test_a_box_beside_a_wall_is_a_box_as_long_as_floor_is_seen_between_them(gap: float) -> None:
    grid, box = near_a_wall(gap)
    assert standing_free([box], grid, RADIUS) == (box,)


def test_a_box_behind_which_nobody_has_looked_is_one_but_a_piece_of_an_unseen_wall_is_not_shown_as_one() -> None:
    grid, box = near_a_wall(0.26)
    hidden = grid.probability.copy()
    hidden[8:12, 18:22] = 0.5  # its shadow on the wall
    assert standing_free([box], replace(grid, probability=hidden), RADIUS) == (box,)
    in_the_open, alone = near_a_wall(0.6)
    assert standing_alone([alone], in_the_open, RADIUS) == (alone,)
    half_known = in_the_open.probability.copy()
    half_known[:, 20:] = 0.5
    assert standing_alone([alone], replace(in_the_open, probability=half_known), RADIUS) == ()


@pytest.mark.parametrize("turns", range(4))
def test_the_end_of_a_wall_is_neither_even_with_a_gap_in_it(turns: int) -> None:
    probability = np.zeros((40, 40), np.float32)
    probability[19:21, 18:] = 1.0
    for unseen in (slice(0, 0), slice(21, 22)):
        gapped = probability.copy()
        gapped[19:21, unseen] = 0.5
        grid = OccupancyGrid(np.rot90(gapped, turns).copy(), 0.05)
        x, y = np.array([-0.03, 0.0]) @ np.linalg.matrix_power(np.array([[0, -1], [1, 0]]), turns) + 1.0
        alleged = Box(0, float(x), float(y), 99, 99)
        assert standing_free([alleged], grid, RADIUS) == ()
        assert standing_alone([alleged], grid, RADIUS) == ()


def test_a_map_without_its_boxes_is_the_map_of_the_building() -> None:
    plan = find_world("rooms")
    cells = [cell for cell in plan.cells() if cell not in plan.warehouse][5::40]
    empty = perfect_map(plan)
    boxes = [Box(i, *centre(plan, cell).tolist(), 9, 9) for i, cell in enumerate(cells)]
    probability = empty.probability.copy()
    points = empty.centres(np.argwhere(np.ones(empty.shape, np.bool_)))
    for box in boxes:
        rim = np.abs(np.hypot(points[:, 0] - box.x, points[:, 1] - box.y) - RADIUS) < 0.03
        probability.reshape(-1)[rim] = 1.0
    with_boxes = replace(empty, probability=probability)
    assert with_boxes.occupied.sum() > empty.occupied.sum()
    cleared = without_boxes(with_boxes, boxes, RADIUS)
    np.testing.assert_array_equal(cleared.occupied, empty.occupied)
    assert open_ways(plan_of_map(cleared, frame_of(plan), BODY.radius)) == open_ways(plan)


def open_ways(plan: FloorPlan) -> tuple[set[Cell], frozenset[Wall]]:
    """The open cells, and the walls between two of them."""
    cells = set(plan.cells())
    walls = {wall for wall in plan.walls if wall.cell in cells}
    beyond = {wall: Cell(wall.cell.x + (not wall.north), wall.cell.y + wall.north) for wall in walls}
    return cells, frozenset(wall for wall in walls if beyond[wall] in cells)
