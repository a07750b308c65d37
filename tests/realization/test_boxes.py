"""Boxes: detection in scans, confirmation of tracks, and rejection of wall ends that look like cylinders."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from wherry.floorplan.plan import Cell, FloorPlan, Wall
from wherry.floorplan.world_files import find_world, parse_world
from wherry.realization.box_detection import detect_cylinders
from wherry.realization.box_isolation import erase_boxes, isolated_boxes, isolated_boxes_on_partial_map
from wherry.realization.box_tracks import MIN_DETECTIONS, BoxTrack, update_tracks
from wherry.realization.cells import floor_plan_from_map
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
POSITIONS = [(2.1, 0.35), (2.4, 0.9), (1.9, 0.3), (2.9, 0.6), (0.3, 0.9)]
HEADINGS = [0.0, 1.0, 2.5, -2.0]


def detections_in(lidar: MovableLidar, base: Pose, boxes: Floats) -> Floats:
    """[K, 2] centres of the detected cylinders, m, world frame."""
    return (base @ BODY.lidar).transform(detect_cylinders(lidar.scan(base, boxes), RADIUS))


@pytest.mark.parametrize("heading", HEADINGS)
@pytest.mark.parametrize("position", POSITIONS)
def test_a_box_is_located_to_a_millimetre_in_an_exact_scan(position: tuple[float, float], heading: float) -> None:
    centres = detections_in(EXACT, Pose(1.2, 0.9, heading), np.array([position]))
    assert centres.shape == (1, 2)
    np.testing.assert_allclose(centres[0], position, atol=0.001)


@pytest.mark.parametrize("position", POSITIONS)
def test_a_box_is_located_to_one_and_a_half_centimetres_in_a_noisy_scan(position: tuple[float, float]) -> None:
    errors = []
    for heading in np.linspace(-3.0, 3.0, 20):
        centres = detections_in(NOISY, Pose(1.2, 0.9, heading), np.array([position]))
        errors += np.hypot(*(centres - position).T).tolist()
    assert len(errors) >= 12  # near the detection range, noise prevents some detections
    assert np.median(errors) < 0.007
    assert np.quantile(errors, 0.95) < 0.015


def test_several_boxes_in_one_scan_are_detected() -> None:
    boxes = np.array([(2.1, 0.35), (2.4, 0.9), (0.3, 0.9)])
    centres = detections_in(EXACT, Pose(1.2, 0.9, 0.4), boxes)
    assert len(centres) == 3
    np.testing.assert_allclose(centres[np.argsort(centres[:, 0])], boxes[np.argsort(boxes[:, 0])], atol=0.001)


def test_a_box_hit_by_beam_0_is_detected_as_one_segment() -> None:
    # Beam 0 points backwards, so the segment on this box wraps around from the last beam to the first.
    base = Pose(1.8, 0.9, 0.0)
    behind = np.array([[base.x - 1.0, base.y]])
    scan = EXACT.scan(base, behind)
    assert scan.ranges[0] < 1.0
    assert scan.ranges[-1] < 1.0
    np.testing.assert_allclose(detections_in(EXACT, base, behind), behind, atol=0.001)


@pytest.mark.parametrize("name", ["small", "rooms", "taxi", "taxi10"])
def test_walls_jambs_and_obstacles_never_become_isolated_boxes(name: str) -> None:
    plan = find_world(name)
    plan = plan.with_boxes(())
    lidar, rng = MovableLidar(plan, noise=0.01), np.random.default_rng(1)
    grid = perfect_map(plan)
    boxes: tuple[BoxTrack, ...] = ()
    cells = sorted(plan.cells())[:: max(1, len(list(plan.cells())) // 60)]
    for cell in cells:
        for _ in range(4):
            x, y = centre(plan, cell)
            pose = Pose(x, y, rng.uniform(-math.pi, math.pi))
            boxes = update_tracks(boxes, lidar.scan(pose), pose, BODY)
    assert isolated_boxes(boxes, grid, RADIUS) == ()


def test_missed_opportunities_revoke_the_confirmation_of_a_walls_end() -> None:
    """A wall's end may be detected as a cylinder by chance; scans without a detection revoke the confirmation."""
    end = BoxTrack(0, 1.2, 1.5, MIN_DETECTIONS, MIN_DETECTIONS)
    before, far = Pose(1.0, 0.6, 0.0), Pose(3.6, 0.4, 0.0)
    assert end.is_confirmed
    (unchanged,) = update_tracks([end], EXACT.scan(far, np.empty((0, 2))), far, BODY)
    assert unchanged == end, "out of detection range"
    hidden = EXACT.scan(before, np.array([[1.1, 1.05]]))
    assert update_tracks([end], hidden, before, BODY)[0] == end, "occluded"
    boxes: tuple[BoxTrack, ...] = (end,)
    for _ in range(MIN_DETECTIONS + 1):
        boxes = update_tracks(boxes, EXACT.scan(before, np.empty((0, 2))), before, BODY)
    assert not boxes[0].is_confirmed


@pytest.mark.parametrize("position", POSITIONS)
def test_an_unoccluded_box_is_detected_in_most_scans(position: tuple[float, float]) -> None:
    lidar, boxes = MovableLidar(HALL, noise=0.01), tuple[BoxTrack, ...]()
    for heading in np.linspace(-3.0, 3.0, 60):
        pose = Pose(1.2, 0.9, heading)
        boxes = update_tracks(boxes, lidar.scan(pose, np.array([position])), pose, BODY)
    (box,) = (box for box in boxes if math.hypot(box.x - position[0], box.y - position[1]) < 0.05)
    assert box.detections >= 0.8 * box.opportunities


def test_a_false_detection_at_a_walls_end_is_not_isolated() -> None:
    grid = perfect_map(HALL)
    detections = []
    for cell in HALL.cells():
        x, y = centre(HALL, cell)
        detections += detections_in(EXACT, Pose(x, y, 0.3), np.empty((0, 2))).tolist()
    assert len(detections) <= 1
    false_tracks = [BoxTrack(number, x, y, 99, 99) for number, (x, y) in enumerate(detections)]
    assert isolated_boxes(false_tracks, grid, RADIUS) == ()


def test_nothing_is_detected_in_a_scan_without_returns() -> None:
    for value in (math.nan, math.inf):
        scan = Scan(0.0, np.full(360, value), -math.pi, math.tau / 360, 0.02, 12.0)
        assert detect_cylinders(scan, RADIUS).shape == (0, 2)


def test_a_box_out_of_range_is_not_detected() -> None:
    base = Pose(0.9, 0.9, 0.0)
    assert detections_in(EXACT, base, np.array([[4.3, 0.5]])).shape == (0, 2)


def tracks_after(
    lidar: MovableLidar, base: Pose, boxes: Floats, scans: int, before: tuple[BoxTrack, ...] = ()
) -> tuple[BoxTrack, ...]:
    """The tracks after a number of scans from one pose."""
    for _ in range(scans):
        before = update_tracks(before, lidar.scan(base, boxes), base, BODY)
    return before


def test_a_track_is_confirmed_after_enough_detections_and_keeps_its_id() -> None:
    base, position = Pose(1.2, 0.9, 0.2), np.array([[2.4, 0.9]])
    few = tracks_after(NOISY, base, position, MIN_DETECTIONS - 1)
    assert [box.is_confirmed for box in few] == [False]
    (box,) = tracks_after(NOISY, base, position, 1, few)
    assert box.is_confirmed
    assert box.track_id == few[0].track_id == 0
    (box,) = tracks_after(NOISY, base, position, 30, (box,))
    assert math.hypot(box.x - 2.4, box.y - 0.9) < 0.008
    both = tracks_after(NOISY, base, np.array([[2.4, 0.9], [0.3, 0.9]]), 1, (box,))
    assert [box.track_id for box in both] == [0, 1]


def test_the_track_of_a_removed_box_loses_its_confirmation() -> None:
    base, position = Pose(1.2, 0.9, 0.2), np.array([[2.4, 0.9]])
    (box,) = tracks_after(EXACT, base, position, MIN_DETECTIONS)
    (gone,) = tracks_after(EXACT, base, np.empty((0, 2)), MIN_DETECTIONS + 1, (box,))
    assert (gone.detections, gone.opportunities) == (MIN_DETECTIONS, 2 * MIN_DETECTIONS + 1)
    assert not gone.is_confirmed


def test_an_occluded_box_counts_no_missed_opportunity() -> None:
    base = Pose(1.0, 0.9, 0.0)
    (box,) = tracks_after(EXACT, base, np.array([[2.6, 0.9]]), MIN_DETECTIONS)
    after = tracks_after(EXACT, base, np.array([[2.6, 0.9], [1.8, 0.9]]), 3, (box,))
    assert after[0] == box
    assert after[1].is_confirmed is False


@pytest.mark.parametrize("theta", [0.0, 0.5])
def test_a_free_standing_track_is_isolated_and_a_jamb_is_not(theta: float) -> None:
    map_from_world = Pose(3.0, -1.0, theta)
    grid = perfect_map(HALL, map_from_world)
    free, jamb = (1.5, 0.9), (1.2, 1.2)  # in a cell's centre; at a wall's end
    boxes = [
        BoxTrack(number, *map_from_world.transform(np.array([position]))[0].tolist(), MIN_DETECTIONS, MIN_DETECTIONS)
        for number, position in enumerate((free, jamb))
    ]
    assert isolated_boxes(boxes, grid, RADIUS) == (boxes[0],)
    assert isolated_boxes([replace(boxes[0], detections=1)], grid, RADIUS) == ()


def near_a_wall(gap: float) -> tuple[OccupancyGrid, BoxTrack]:
    """A map with a box whose centre is at a distance, m, from a wall's face, and the box's track."""
    probability = np.zeros((40, 40), np.float32)
    probability[:10] = 1.0
    grid = OccupancyGrid(probability, 0.05)
    box = BoxTrack(0, 1.0, 0.5 + gap, MIN_DETECTIONS, MIN_DETECTIONS)
    cells = np.argwhere(np.ones((40, 40), np.bool_))
    rim = np.abs(np.hypot(*(grid.centres(cells) - (box.x, box.y)).T) - RADIUS) < 0.03
    probability.reshape(-1)[rim] = 1.0
    return OccupancyGrid(probability, 0.05), box


@pytest.mark.parametrize("gap", [0.30, 0.26, 0.23])
def test_a_box_near_a_wall_is_isolated_while_the_map_shows_free_space_between_them(gap: float) -> None:
    grid, box = near_a_wall(gap)
    assert isolated_boxes([box], grid, RADIUS) == (box,)


def test_unknown_space_behind_a_box_matters_only_on_a_partial_map() -> None:
    grid, box = near_a_wall(0.26)
    hidden = grid.probability.copy()
    hidden[8:12, 18:22] = 0.5  # the box occludes the wall
    assert isolated_boxes([box], replace(grid, probability=hidden), RADIUS) == (box,)
    open_space, alone = near_a_wall(0.6)
    assert isolated_boxes_on_partial_map([alone], open_space, RADIUS) == (alone,)
    half_known = open_space.probability.copy()
    half_known[:, 20:] = 0.5
    assert isolated_boxes_on_partial_map([alone], replace(open_space, probability=half_known), RADIUS) == ()


@pytest.mark.parametrize("turns", range(4))
def test_a_walls_end_is_not_isolated_even_across_an_unknown_gap(turns: int) -> None:
    probability = np.zeros((40, 40), np.float32)
    probability[19:21, 18:] = 1.0
    for gap in (slice(0, 0), slice(21, 22)):
        gapped = probability.copy()
        gapped[19:21, gap] = 0.5
        grid = OccupancyGrid(np.rot90(gapped, turns).copy(), 0.05)
        x, y = np.array([-0.03, 0.0]) @ np.linalg.matrix_power(np.array([[0, -1], [1, 0]]), turns) + 1.0
        false_track = BoxTrack(0, float(x), float(y), 99, 99)
        assert isolated_boxes([false_track], grid, RADIUS) == ()
        assert isolated_boxes_on_partial_map([false_track], grid, RADIUS) == ()


def test_erasing_boxes_restores_the_map_of_the_building() -> None:
    plan = find_world("rooms")
    cells = [cell for cell in plan.cells() if cell not in plan.warehouse][5::40]
    empty = perfect_map(plan)
    boxes = [BoxTrack(i, *centre(plan, cell).tolist(), 9, 9) for i, cell in enumerate(cells)]
    probability = empty.probability.copy()
    points = empty.centres(np.argwhere(np.ones(empty.shape, np.bool_)))
    for box in boxes:
        rim = np.abs(np.hypot(points[:, 0] - box.x, points[:, 1] - box.y) - RADIUS) < 0.03
        probability.reshape(-1)[rim] = 1.0
    with_boxes = replace(empty, probability=probability)
    assert with_boxes.occupied.sum() > empty.occupied.sum()
    cleared = erase_boxes(with_boxes, boxes, RADIUS)
    np.testing.assert_array_equal(cleared.occupied, empty.occupied)
    assert open_cells_and_walls(floor_plan_from_map(cleared, frame_of(plan), BODY.radius)) == open_cells_and_walls(plan)


def open_cells_and_walls(plan: FloorPlan) -> tuple[set[Cell], frozenset[Wall]]:
    """The open cells, and the walls between two of them."""
    cells = set(plan.cells())
    walls = {wall for wall in plan.walls if wall.cell in cells}
    beyond = {wall: Cell(wall.cell.x + (not wall.north), wall.cell.y + wall.north) for wall in walls}
    return cells, frozenset(wall for wall in walls if beyond[wall] in cells)
