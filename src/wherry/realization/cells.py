"""Discretization of a metric map to a floor plan, and of a scan to touch relations (paper, section 7)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wherry.floorplan.plan import Cell, Direction, FloorPlan, Wall
from wherry.robot import Scan
from wherry.space.distance_field import obstacle_distances
from wherry.space.frame import CellFrame
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose

CLEARANCE_TOLERANCE = 0.05  # m by which a passage may seem narrower than the robot, owing to the map's resolution
PASSAGE_SAMPLES = 13  # points between two cells' centres at which the clearance is sampled
MIN_BLOCKING_BEAMS = 2  # beams that must end in a passage for it to be blocked
BOX_MARGIN = 1.5  # largest distance from a box's centre of a beam end that is attributed to the box ÷ box radius


def floor_plan_from_map(grid: OccupancyGrid, frame: CellFrame, radius: float, name: str = "map") -> FloorPlan:
    """Find the cells in which the robot fits and the walls between them.

    Args:
        grid: The map, without boxes.
        frame: The cell frame on the map.
        radius: Radius of the robot's footprint, m.
        name: Name of the plan.

    Returns:
        A plan without robot, boxes or warehouse. Its obstacles are the cells whose centre is not known to be free or
        has too little clearance.
    """
    clearance = obstacle_distances(grid.occupied, grid.resolution)
    min_clearance = radius - CLEARANCE_TOLERANCE
    columns, rows = _extent(grid, frame)
    cells = [Cell(x, y) for y in range(rows) for x in range(columns)]
    centres = np.array([frame.centre(cell.x, cell.y) for cell in cells])
    is_open = (_sample(grid, clearance, centres) >= min_clearance) & (_sample(grid, grid.free, centres) > 0)
    open_cells = {cell for cell, is_cell_open in zip(cells, is_open, strict=True) if is_cell_open}
    return FloorPlan(
        name=name,
        width=columns,
        height=rows,
        cell_size=frame.cell_size,
        walls=frozenset(_walls_between(open_cells, grid, clearance, frame, min_clearance)),
        obstacles=frozenset(set(cells) - open_cells),
    )


def _extent(grid: OccupancyGrid, frame: CellFrame) -> tuple[int, int]:
    """Number of columns and rows of cells from the frame's origin to the map's farthest corner."""
    height, width = grid.shape
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]]) * grid.resolution
    last_column, last_row = frame.cells_at(grid.origin.transform(corners)).max(axis=0)
    return int(last_column) + 1, int(last_row) + 1


def _walls_between(
    open_cells: set[Cell], grid: OccupancyGrid, clearance: Floats, frame: CellFrame, min_clearance: float
) -> set[Wall]:
    """The edges between open neighbours without the minimum clearance on the line between their centres."""
    passages = [
        (cell, direction)
        for cell in open_cells
        for direction in (Direction.NORTH, Direction.EAST)
        if cell.neighbour(direction) in open_cells
    ]
    if not passages:
        return set()
    starts = np.array([frame.centre(cell.x, cell.y) for cell, _ in passages])[:, None, :]
    neighbours = [cell.neighbour(direction) for cell, direction in passages]
    ends = np.array([frame.centre(cell.x, cell.y) for cell in neighbours])[:, None, :]
    samples = starts + np.linspace(0, 1, PASSAGE_SAMPLES)[None, :, None] * (ends - starts)
    narrowest = _sample(grid, clearance, samples.reshape(-1, 2)).reshape(len(passages), PASSAGE_SAMPLES).min(axis=1)
    return {Wall.between(*passage) for passage, width in zip(passages, narrowest, strict=True) if width < min_clearance}


def _sample(grid: OccupancyGrid, values: NDArray[np.float64] | NDArray[np.bool_], points: Floats) -> Floats:
    """[N] values of the grid cells, from [H, W], that contain points [N, 2], m, map frame; 0 outside the map."""
    cells = grid.cells_at(points)
    inside = grid.contains(cells)
    sampled: Floats = np.zeros(len(points))
    sampled[inside] = values[cells[inside, 0], cells[inside, 1]]
    return sampled


def occupied_cells(grid: OccupancyGrid, frame: CellFrame, plan: FloorPlan) -> frozenset[Cell]:
    """The cells that are occupied near their centre, for example by a box; walls lie on the cells' edges."""
    points = grid.occupied_points()
    cells = frame.cells_at(points)
    is_inner = np.hypot(*(points - frame.centres(cells)).T) < frame.cell_size / 3
    occupied = {Cell(x, y) for x, y in np.unique(cells[is_inner], axis=0).tolist()}
    return frozenset(cell for cell in occupied if plan.contains(cell))


def blocked_directions(
    scan: Scan, lidar: Pose, cell: Cell, frame: CellFrame, radius: float, boxes: Floats, box_radius: float
) -> dict[Direction, bool]:
    """Compute touch_N, touch_S, touch_E and touch_W from a scan, for the directions that it observes.

    A passage is the strip, as wide as the robot, from the cell's centre to the robot's front when it stands in the next
    cell. It is blocked if beams end in it on anything but a box, and open if beams cross its whole width and end beyond
    it. A direction may be unobserved where a box in the fork occludes it.

    Args:
        scan: The scan.
        lidar: The lidar in the map frame.
        cell: The robot's cell.
        frame: The cell frame on the map.
        radius: Radius of the robot's footprint, m.
        boxes: [B, 2] centres of the boxes on the floor or in the fork, m, map frame.
        box_radius: Radius of a box, m.

    Returns:
        Whether the passage is blocked, for each observed direction.
    """
    ends, lengths, has_return = _beam_ends(scan, lidar)
    for box in boxes:
        has_return &= np.hypot(ends[:, 0] - box[0], ends[:, 1] - box[1]) > BOX_MARGIN * box_radius
    centre = frame.centre(cell.x, cell.y)
    passage_length = frame.cell_size + radius - CLEARANCE_TOLERANCE
    half_width = radius - CLEARANCE_TOLERANCE / 2
    blocked = {}
    for direction in Direction:
        heading = frame.heading(direction.dx, direction.dy)
        local = Pose(float(centre[0]), float(centre[1]), heading).inverse.transform(ends)
        along, lateral = local[:, 0], np.abs(local[:, 1])
        is_inside = has_return & (along > 0) & (along < passage_length) & (lateral < half_width)
        is_beyond = (along >= passage_length) & (lateral < along) & (lengths > 0)
        if np.count_nonzero(is_inside) >= MIN_BLOCKING_BEAMS:
            blocked[direction] = True
        elif _cross_whole_width(local[is_beyond], frame.cell_size, radius):
            blocked[direction] = False
    return blocked


def _beam_ends(scan: Scan, lidar: Pose) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """[R, 2] beam ends, m, map frame; [R] beam lengths, m; [R] True for beams with a return.

    A beam without a return ends at the maximum range, an invalid beam at the lidar.
    """
    has_return = scan.valid
    lengths = np.where(has_return, scan.ranges, np.where(np.isposinf(scan.ranges), scan.range_max, 0.0))
    ends = lidar.transform(np.column_stack([lengths * np.cos(scan.angles), lengths * np.sin(scan.angles)]))
    return ends, lengths, has_return


def _cross_whole_width(points: Floats, distance: float, radius: float) -> bool:
    """Whether beams cross the left, the middle and the right third of a passage's end.

    Args:
        points: [N, 2] ends of the beams, m, in the frame of the passage's start, x along it.
        distance: Distance from the passage's start to its end, m.
        radius: Half the passage's width, m.
    """
    if not len(points):
        return False
    crossings = points[:, 1] * distance / points[:, 0]
    thirds = [(-radius, -radius / 3), (-radius / 3, radius / 3), (radius / 3, radius)]
    return all(bool(np.any((crossings >= low) & (crossings <= high))) for low, high in thirds)
