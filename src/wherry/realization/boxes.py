"""Cylindrical boxes as a lidar sees them: round things that the map does not explain (paper, Fig. 3)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from wherry.robot import Body, Scan
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose

# What counts as round. Ranges have about 1 cm of noise; a door jamb or a wall's end is flat or goes on.
FARTHEST = 2.2  # m; beyond it fewer than five beams of a degree meet a box of 10 cm
UNMISTAKABLE = 1.5  # m, within which a box in full view is not overlooked
FEWEST_BEAMS = 5
STANDS_OUT = 0.12  # m that the beams at both sides must reach beyond the box's rim
LARGEST_RESIDUAL = 0.02  # m, rms distance of its points from the circle
NARROWEST = 1.2  # chord ÷ radius

# When a round thing is believed to be a box.
SAME_BOX = 0.25  # m; two sightings nearer than this are of one box
FEWEST_SIGHTINGS = 5
RIM = 0.05  # m around a box in which the map may still show it
RING = 0.075  # m around that in which nothing may hang together with the box
GAP = 0.05  # m around it in which not even something may that the map shows behind what it does not know
ALONE = 0.25  # m around it likewise, for what is to be shown as a box while the map grows
KNOWN_FREE = 0.7  # share of that ring which must be known to be free: a box seen from one side hides a fifth of it
SMALLEST_SHARE = 0.5  # sightings ÷ looks at the place with nothing in between


def round_things(scan: Scan, radius: float) -> Floats:
    """Find the cylinders of a known radius in a scan.

    Beams are cut into runs where the range jumps; a run is a cylinder if it stands out before what is beside it, is as
    wide as a cylinder and lies on a circle of that radius.

    Args:
        scan: A full turn, or a part of one.
        radius: m.

    Returns:
        [K, 2] m, the middles, in the lidar's frame.
    """
    ranges = np.where(scan.valid, scan.ranges, np.inf)
    middles = [_fit(scan, ranges, start, end, radius) for start, end in _runs(ranges)]
    found = [middle for middle in middles if middle is not None]
    return np.array(found) if found else np.empty((0, 2))


def _runs(ranges: Floats) -> list[tuple[int, int]]:
    """First and one-past-last beams of the runs without a jump that are near and long enough; one may wrap around."""
    following = np.roll(ranges, -1)
    with np.errstate(invalid="ignore"):
        jumps = ~(np.abs(following - ranges) < STANDS_OUT / 2)  # also between two beams that met nothing
    lasts = np.flatnonzero(jumps)
    if len(lasts) < 2:
        return []
    firsts = np.roll(lasts, 1) + 1
    firsts[0] -= len(ranges)  # the run that wraps begins at a negative beam
    worthwhile = (lasts - firsts + 1 >= FEWEST_BEAMS) & (ranges[firsts] < FARTHEST + STANDS_OUT)
    return list(zip(firsts[worthwhile].tolist(), (lasts[worthwhile] + 1).tolist(), strict=True))


def _fit(scan: Scan, ranges: Floats, start: int, end: int, radius: float) -> Floats | None:
    """[2] m, lidar frame: the middle of the cylinder that the beams ``start`` to ``end`` meet, if they do."""
    beams = np.arange(start, end)
    distances = ranges[beams]
    beside = np.array([ranges[start - 1], ranges[end % len(ranges)]])
    if np.any(beside < distances[[0, -1]] + STANDS_OUT / 2) or np.any(beside < distances.min() + STANDS_OUT):
        return None
    angles = scan.angle_min + scan.angle_increment * beams
    points = np.column_stack([distances * np.cos(angles), distances * np.sin(angles)])
    chord = float(np.hypot(*(points[-1] - points[0])))
    if not NARROWEST * radius <= chord <= 2 * radius + 2 * LARGEST_RESIDUAL:
        return None
    return _fit_circle(points, radius)


def _fit_circle(points: Floats, radius: float) -> Floats | None:
    """[2] m: the middle of the circle of a known radius through points [N, 2], by Gauss–Newton; None if far from it."""
    nearest = points[np.argmin(np.hypot(points[:, 0], points[:, 1]))]
    middle = nearest * (1 + radius / np.hypot(*nearest))  # behind the point that is nearest to the lidar
    residuals = np.empty(len(points))
    for _ in range(6):
        offsets = middle - points
        lengths = np.maximum(np.hypot(offsets[:, 0], offsets[:, 1]), 1e-9)
        residuals = lengths - radius
        directions = offsets / lengths[:, None]
        # Levenberg's damping keeps a nearly straight run of points from throwing the middle far off.
        normal = directions.T @ directions + 1e-3 * np.eye(2)
        middle = middle - np.linalg.solve(normal, directions.T @ residuals)
    return middle if math.sqrt(float(np.mean(residuals**2))) <= LARGEST_RESIDUAL else None


@dataclass(frozen=True, slots=True)
class Box:
    """A round thing at a place.

    Attributes:
        number: Its name: 0 for the first one that was seen.
        x: m, map frame.
        y: m, map frame.
        sightings: How often it was seen.
        looks: How often its place was looked at.
    """

    number: int
    x: float
    y: float
    sightings: int = 1
    looks: int = 1

    @property
    def certain(self) -> bool:
        """Whether it was seen often enough, and more often than not."""
        return self.sightings >= FEWEST_SIGHTINGS and self.sightings >= SMALLEST_SHARE * self.looks


def look_for_boxes(boxes: Sequence[Box], scan: Scan, pose: Pose, body: Body) -> tuple[Box, ...]:
    """Update what is believed of the boxes with what a scan shows.

    Args:
        boxes: The belief so far.
        scan: A scan.
        pose: base_link in the map frame when it was taken.
        body: The robot's shape.

    Returns:
        The new belief: places of boxes seen again are averaged; what is seen empty, or in full view and not round,
        counts against a box.
    """
    lidar = pose @ body.lidar
    found = lidar.transform(round_things(scan, body.box_radius))
    unmatched = list(range(len(found)))
    updated = []
    for box in boxes:
        distances = [math.hypot(found[i, 0] - box.x, found[i, 1] - box.y) for i in unmatched]
        if distances and min(distances) < SAME_BOX:
            index = unmatched.pop(int(np.argmin(distances)))
            updated.append(_seen_again(box, found[index], lidar))
        elif _would_be_seen(scan, lidar, box, body.box_radius):
            updated.append(replace(box, looks=box.looks + 1))
        else:
            updated.append(box)
    number = max((box.number for box in boxes), default=-1) + 1
    fresh = [Box(number + k, float(found[i, 0]), float(found[i, 1])) for k, i in enumerate(unmatched)]
    return (*updated, *fresh)


def _seen_again(box: Box, found: Floats, lidar: Pose) -> Box:
    """Move a box towards where it was seen, the more the nearer it was (pose errors grow with the distance)."""
    distance = math.hypot(found[0] - lidar.x, found[1] - lidar.y)
    weight = max(1 / (box.sightings + 1), 0.3 if distance < 1.0 else 0.0)
    return replace(
        box,
        x=box.x + weight * (float(found[0]) - box.x),
        y=box.y + weight * (float(found[1]) - box.y),
        sightings=box.sightings + 1,
        looks=box.looks + 1,
    )


def _would_be_seen(scan: Scan, lidar: Pose, box: Box, radius: float) -> bool:
    """Whether a scan shows a box's place so well that a box there would be among its round things.

    Either the beams towards it all reach well beyond it; or nothing stands before it, so near that it is unmistakable.
    """
    dx, dy = box.x - lidar.x, box.y - lidar.y
    distance, bearing = math.hypot(dx, dy), math.atan2(dy, dx) - lidar.theta
    if not 3 * radius < distance < FARTHEST:
        return False
    if np.all(_ranges_towards(scan, bearing, math.asin(radius / distance)) > distance + 2 * radius):
        return True
    beside = _ranges_towards(scan, bearing, math.asin(1.5 * radius / distance))
    return distance < UNMISTAKABLE and bool(np.all(beside > distance - 1.5 * radius))


def _ranges_towards(scan: Scan, bearing: float, aside: float) -> Floats:
    """[N] m, of the beams up to an angle aside of a bearing, rad, lidar frame; 0 where they tell nothing."""
    middle = round((bearing - scan.angle_min) / scan.angle_increment)
    half = max(int(aside / abs(scan.angle_increment)), 1)
    beams = np.arange(middle - half, middle + half + 1) % len(scan.ranges)
    return np.where(np.isnan(scan.ranges[beams]), 0.0, scan.ranges[beams])


def standing_free(boxes: Sequence[Box], grid: OccupancyGrid, radius: float) -> tuple[Box, ...]:
    """The certain boxes that nothing on the map goes on from; what goes on is a wall's end or a jamb.

    Args:
        boxes: Round things.
        grid: The map; boxes may be on it or not.
        radius: m, of a box.
    """
    return tuple(box for box in boxes if box.certain and not _Surroundings.of(box, grid, radius).go_on)


def standing_alone(boxes: Sequence[Box], grid: OccupancyGrid, radius: float) -> tuple[Box, ...]:
    """Those from which nothing can go on even where a map that grows has gaps yet: surely boxes."""
    return tuple(box for box in boxes if box.certain and _Surroundings.of(box, grid, radius).are_free)


@dataclass(frozen=True)
class _Surroundings:
    """What a map shows around a box.

    Attributes:
        away: [H, W] m, from its rim and what may still be of it; at most 0 on it.
        free: [H, W] where the map shows free floor.
        occupied: [H, W] where it shows something.
    """

    away: Floats
    free: NDArray[np.bool_]
    occupied: NDArray[np.bool_]

    @classmethod
    def of(cls, box: Box, grid: OccupancyGrid, radius: float) -> _Surroundings:
        """Cut them out of a map."""
        place = _around(box, grid, radius + RIM + ALONE)
        away = _distances(box, grid, place) - radius - RIM
        return cls(away, grid.free[place], grid.occupied[place])

    @property
    def go_on(self) -> bool:
        """Whether a piece of what the map shows goes on from the box's rim to beyond it.

        A wall's cells hang together; a gap between them that was not seen is small.
        """
        return self._leads_on(self.occupied, RING) or self._leads_on(~self.free, GAP)

    @property
    def are_free(self) -> bool:
        """Whether the box has free floor around it, and nothing may go on from it where the map has gaps."""
        ring = (self.away > 0.0) & (self.away < RING)
        known_free = bool(ring.any()) and float(np.mean(self.free[ring])) >= KNOWN_FREE
        return known_free and not self._leads_on(~self.free, ALONE)

    def _leads_on(self, filled: NDArray[np.bool_], reach: float) -> bool:
        """Whether something occupied is beyond the rim, up to a reach, m, in the piece of what is filled there."""
        return bool(np.any(self._piece(filled & (self.away < reach)) & self.occupied & (self.away > 0.0)))

    def _piece(self, filled: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """[H, W] what hangs together with the box."""
        pieces, _ = ndimage.label(filled | (self.away <= 0.0), structure=np.ones((3, 3)))  # corners touch, too
        of_box: NDArray[np.bool_] = (pieces > 0) & np.isin(pieces, pieces[self.away <= 0.0])
        return of_box


def without_boxes(grid: OccupancyGrid, boxes: Sequence[Box], radius: float) -> OccupancyGrid:
    """The map with the boxes' places free, since boxes go and walls stay; the map itself where there are no boxes."""
    if not boxes:
        return grid
    probability = grid.probability.copy()
    reach = radius + 1.5 * grid.resolution
    for box in boxes:
        place = _around(box, grid, reach)
        probability[place][_distances(box, grid, place) < reach] = 0.0
    return replace(grid, probability=probability)


def _around(box: Box, grid: OccupancyGrid, reach: float) -> tuple[slice, slice]:
    """Rows and columns of a map that hold all its cells within a reach, m, of a box's middle."""
    row, column = grid.cells_at(np.array([[box.x, box.y]]))[0].tolist()
    half = math.ceil(reach / grid.resolution) + 1
    return (
        slice(max(row - half, 0), max(row + half + 1, 0)),
        slice(max(column - half, 0), max(column + half + 1, 0)),
    )


def _distances(box: Box, grid: OccupancyGrid, place: tuple[slice, slice]) -> Floats:
    """[H, W] m, from a box's middle to the middles of a map's cells in some rows and columns."""
    rows, columns = place
    shape = grid.probability[place].shape
    cells = np.argwhere(np.ones(shape, np.bool_)) + np.array([rows.start, columns.start])
    distances: Floats = np.hypot(*(grid.centres(cells) - [box.x, box.y]).T).reshape(shape)
    return distances
