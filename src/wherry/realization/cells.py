"""From a map in metres to a floor plan in cells, from a live scan to the touch relations (paper, section 7)."""

from __future__ import annotations

import math

import numpy as np
from scipy import ndimage

from wherry.floorplan.plan import Cell, Direction, FloorPlan, Wall
from wherry.robot import Scan
from wherry.space.frame import CellFrame
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose

SLACK = 0.05  # m that a way may be narrower than the robot on a map, whose cells round by about as much
PROBES = 13  # points at which the way from one cell to the next is looked at
FEWEST_RETURNS = 2  # beams that must agree before the live scan says that a way is blocked


def plan_of_map(grid: OccupancyGrid, frame: CellFrame, radius: float, name: str = "map") -> FloorPlan:
    """Read a map as cells: which ones a robot can stand in, and between which ones it can go.

    Args:
        grid: The map, without boxes.
        frame: Where the cells lie.
        radius: m, of the robot's footprint.
        name: What to call the plan.

    Returns:
        A plan without robot, boxes or warehouse; its obstacles are all cells that the robot cannot stand in or that
        the map does not know.
    """
    clearance = ndimage.distance_transform_edt(~grid.occupied, sampling=grid.resolution)
    height, width = grid.probability.shape
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]]) * grid.resolution
    farthest = frame.cells_at(grid.origin.transform(corners)).max(axis=0)
    columns, rows = int(farthest[0]) + 1, int(farthest[1]) + 1
    needed = radius - SLACK

    def looked_up(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]], points: Floats) -> Floats:
        """The grid's values at points [N, 2] m of the map frame; 0 beyond its edge."""
        cells = np.floor(grid.origin.inverse.transform(points) / grid.resolution).astype(np.int64)
        inside = np.all((cells >= 0) & (cells < (width, height)), axis=1)
        found: Floats = np.zeros(len(points))
        found[inside] = values[cells[inside, 1], cells[inside, 0]]
        return found

    cells = [Cell(x, y) for y in range(rows) for x in range(columns)]
    centres = np.array([frame.centre(cell.x, cell.y) for cell in cells])
    open_cells = (looked_up(clearance, centres) >= needed) & (looked_up(grid.free.astype(float), centres) > 0)
    standable = {cell for cell, is_open in zip(cells, open_cells, strict=True) if is_open}

    ways = [
        (cell, direction)
        for cell in standable
        for direction in (Direction.NORTH, Direction.EAST)
        if cell.neighbour(direction) in standable
    ]
    walls = set()
    if ways:
        shares = np.linspace(0, 1, PROBES)[None, :, None]
        begins = np.array([frame.centre(cell.x, cell.y) for cell, _ in ways])[:, None, :]
        ends = np.array([frame.centre(*_xy(cell.neighbour(direction))) for cell, direction in ways])[:, None, :]
        probes = (begins + shares * (ends - begins)).reshape(-1, 2)
        narrowest = looked_up(clearance, probes).reshape(len(ways), PROBES).min(axis=1)
        walls = {Wall.between(*way) for way, width_m in zip(ways, narrowest, strict=True) if width_m < needed}
    return FloorPlan(
        name=name,
        width=columns,
        height=rows,
        cell_size=frame.cell_size,
        walls=frozenset(walls),
        obstacles=frozenset(set(cells) - standable),
    )


def occupied_cells(grid: OccupancyGrid, frame: CellFrame, plan: FloorPlan) -> frozenset[Cell]:
    """The cells in whose middle the map shows something: not a wall, nor an obstacle's face, but maybe a box."""
    points = grid.occupied_points()
    cells = frame.cells_at(points)
    middles = frame.origin.transform((cells + 0.5) * frame.cell_size)
    inner = np.hypot(*(points - middles).T) < frame.cell_size / 3
    found = {Cell(x, y) for x, y in np.unique(cells[inner], axis=0).tolist()}
    return frozenset(cell for cell in found if plan.contains(cell))


def _xy(cell: Cell) -> tuple[int, int]:
    return cell.x, cell.y


def ways_seen(
    scan: Scan, lidar: Pose, cell: Cell, frame: CellFrame, radius: float, boxes: Floats, box_radius: float
) -> dict[Direction, bool]:
    """touch_N, touch_S, touch_E, touch_W from a live scan, as far as it shows them.

    A way is the strip, as wide as the robot, from the middle of the cell to where the robot's front would be in the
    next one. It is blocked if beams end in it, on something other than a box; it is open if beams that cross it reach
    beyond it; with a box in the fork the laser may see neither.

    Args:
        scan: The scan.
        lidar: The lidar's pose in the map frame.
        cell: The cell that the robot stands in.
        frame: Where the cells lie.
        radius: m, of the robot's footprint.
        boxes: [B, 2] m, map frame: boxes on the floor or in the fork.
        box_radius: m.

    Returns:
        For each direction that the scan shows, whether the way is blocked.
    """
    angles = scan.angles
    met = scan.valid
    reached = np.where(met, scan.ranges, np.where(np.isposinf(scan.ranges), scan.range_max, 0.0))
    points = lidar.transform(np.column_stack([reached * np.cos(angles), reached * np.sin(angles)]))
    for box in boxes:
        met &= np.hypot(points[:, 0] - box[0], points[:, 1] - box[1]) > 1.5 * box_radius
    middle = frame.centre(cell.x, cell.y)
    seen = {}
    for direction in Direction:
        heading = frame.heading(direction.dx, direction.dy)
        local = Pose(float(middle[0]), float(middle[1]), heading).inverse.transform(points)
        along, aside = local[:, 0], np.abs(local[:, 1])
        in_the_way = met & (along > 0) & (along < frame.cell_size + radius - SLACK) & (aside < radius - SLACK / 2)
        beyond = (along >= frame.cell_size + radius - SLACK) & (aside < along) & (reached > 0)
        if np.count_nonzero(in_the_way) >= FEWEST_RETURNS:
            seen[direction] = True
        elif _covers(local[beyond], frame.cell_size, radius):
            seen[direction] = False
    return seen


def _covers(points: Floats, distance: float, radius: float) -> bool:
    """Whether beams that go on beyond a way cross its far end at the left, in the middle and at the right.

    Args:
        points: [N, 2] m where the beams ended, seen from the way's beginning, x along it.
        distance: m to the way's far end.
        radius: m, half its width.
    """
    if not len(points):
        return False
    crossing = points[:, 1] * distance / points[:, 0]
    thirds = [(-radius, -radius / 3), (-radius / 3, radius / 3), (radius / 3, radius)]
    return all(bool(np.any((crossing >= low) & (crossing <= high))) for low, high in thirds)


def aligned(heading: float, frame: CellFrame) -> Direction:
    """The direction of the grid that a heading of the map frame, rad, is nearest to."""
    return min(Direction, key=lambda d: abs(math.remainder(frame.heading(d.dx, d.dy) - heading, math.tau)))
