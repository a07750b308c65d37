"""Buildings, and drives through them with scans, odometry and the truth."""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from wherry.robot import Odometry, Scan, Velocity
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose
from wherry.space.raycast import cast_rays

RESOLUTION = 0.02  # m, side of a cell
BEAMS = 360
RANGE_MAX = 12.0  # m
LIDAR = Pose(-0.15, 0.0, 0.0)


def building() -> NDArray[np.bool_]:
    """Blocked cells of 12 × 8 m, [400, 600]: two rooms above a corridor and two below, all different, with doors."""
    blocked = np.zeros((400, 600), np.bool_)
    blocked[:3], blocked[-3:], blocked[:, :3], blocked[:, -3:] = True, True, True, True
    blocked[160:163, :], blocked[237:240, :] = True, True  # the corridor's walls
    blocked[:160, 280:283], blocked[240:, 360:363] = True, True
    for row, column in ((160, 100), (160, 450), (237, 200), (237, 500)):  # doors
        blocked[row : row + 3, column : column + 50] = False
    blocked[60:90, 60:100], blocked[300:340, 120:145], blocked[40:60, 400:470] = True, True, True  # furniture
    blocked[90:120, 540:], blocked[330:360, 550:570] = True, True
    return blocked


@dataclass(frozen=True)
class Drive:
    """Scans and odometry with the truth.

    Attributes:
        scans: Scans, N.
        odometry: Drifting odometry at each scan, N.
        truth: True base_link relative to the first pose, [N, 3] m, m, rad.
        start: True first pose in the building's frame.
    """

    scans: list[Scan]
    odometry: list[Odometry]
    truth: Floats
    start: Pose


WAYPOINTS = [
    (2.4, 2.4),
    (2.4, 4.0),
    (9.4, 4.0),
    (9.4, 2.0),
    (9.4, 4.0),
    (4.5, 4.0),
    (4.5, 6.0),
    (4.5, 4.0),
    (10.4, 4.0),
    (10.4, 6.5),
]
WAYPOINTS += [(10.4, 4.0), (2.4, 4.0), (2.4, 2.4)]


ROOMS = 6  # rooms on each side of the long corridor
ROOM_PITCH = 5.0  # m from one room to the next


def identical_rooms() -> NDArray[np.bool_]:
    """Blocked cells of 30 × 12 m, [600, 1500]: a corridor of 30 m between identical rooms on both sides.

    Only the ends of the corridor tell the position along it, and the lidar reaches them only nearby.
    """
    room = round(ROOM_PITCH / RESOLUTION)
    half = np.zeros((300, ROOMS * room), np.bool_)
    half[:3] = True
    half[245:248] = True  # the corridor's wall, 2 m wide in all
    for number in range(ROOMS):
        half[:248, number * room : number * room + 3] = True
        half[245:248, number * room + 100 : number * room + 150] = False  # its door
        half[40:70, number * room + 180 : number * room + 220] = True  # its table
    blocked = np.vstack([half, half[::-1]])
    blocked[:, :3], blocked[:, -3:] = True, True
    return blocked


def corridor_waypoints(visits: Sequence[tuple[int, int]]) -> list[tuple[float, float]]:
    """Waypoints, m, along the corridor of `identical_rooms` and back, into rooms (number, 1 above or -1 below)."""
    waypoints = [(1.0, 6.0)]
    for number, side in visits:
        door = ROOM_PITCH * number + 2.5
        waypoints += [(door, 6.0), (door, 6.0 + 3.5 * side), (door, 6.0)]
    return [*waypoints, (1.0, 6.0)]


def drive(
    noise: float = 0.0,
    drift: float = 0.0,
    seed: int = 0,
    spacing: float = 0.1,
    *,
    blocked: NDArray[np.bool_] | None = None,
    waypoints: Sequence[tuple[float, float]] = WAYPOINTS,
    range_max: float = RANGE_MAX,
) -> Drive:
    """Drive along waypoints through a building.

    Args:
        noise: Standard deviation of the ranges, m.
        drift: Scale error of the odometry, both systematic and random.
        seed: Seed of the noise.
        spacing: Distance from scan to scan, m.
        blocked: Blocked cells of the building, [H, W]; None for `building`.
        waypoints: Positions in the building's frame, m.
        range_max: Longest range of the lidar, m.
    """
    rng = np.random.default_rng(seed)
    truth = list(_poses(waypoints, spacing))
    poses = np.array([(pose @ LIDAR).as_array() for pose in truth])
    angles = np.linspace(-math.pi, math.pi, BEAMS, endpoint=False)
    ranges = cast_rays(building() if blocked is None else blocked, RESOLUTION, Pose(), poses, angles, range_max)
    ranges += rng.normal(0.0, 1.0, ranges.shape) * noise
    scans = [Scan(0.1 * n, row, -math.pi, math.tau / BEAMS, 0.05, range_max) for n, row in enumerate(ranges)]
    odometry = [Odometry(0.0, Pose(), Velocity())]
    for n in range(1, len(truth)):
        moved = truth[n].relative_to(truth[n - 1])
        wrong = 1.0 + drift * (1.0 + rng.normal(0.0, 1.0, 2))
        slipped = Pose(moved.x * wrong[0], moved.y * wrong[0], moved.theta * wrong[1])
        odometry.append(Odometry(0.1 * n, odometry[-1].pose @ slipped, Velocity()))
    relative = np.array([pose.relative_to(truth[0]).as_array() for pose in truth])
    return Drive(scans, odometry, relative, truth[0])


def _poses(waypoints: Sequence[tuple[float, float]], spacing: float) -> Iterator[Pose]:
    """Poses along straight lines between waypoints, turning on the spot in steps of 5°."""
    heading = math.pi / 2.0
    for (x, y), (next_x, next_y) in itertools.pairwise(waypoints):
        bearing = math.atan2(next_y - y, next_x - x)
        turn = math.remainder(bearing - heading, math.tau)
        for share in np.linspace(0.0, 1.0, max(round(abs(turn) / math.radians(5.0)), 1), endpoint=False):
            yield Pose(x, y, heading + share * turn)
        heading = bearing
        for share in np.linspace(0.0, 1.0, round(math.hypot(next_x - x, next_y - y) / spacing), endpoint=False):
            yield Pose(x + share * (next_x - x), y + share * (next_y - y), heading)
    yield Pose(*waypoints[-1], heading)


def wall_distances(grid: OccupancyGrid, start: Pose, walls: NDArray[np.bool_]) -> Floats:
    """Distances from the centres of occupied cells to the nearest wall, [N] m."""
    to_wall = ndimage.distance_transform_edt(~walls) * RESOLUTION
    cells = np.floor(start.transform(grid.occupied_points()) / RESOLUTION).astype(np.int64)
    columns, rows = np.clip(cells[:, 0], 0, walls.shape[1] - 1), np.clip(cells[:, 1], 0, walls.shape[0] - 1)
    distances: Floats = to_wall[rows, columns]
    return distances


def shared_data(name: str) -> Path:
    """A file of the shared data; the test is skipped if it is missing, except in CI."""
    folder = Path(os.environ.get("WHERRY_DATA", Path(__file__).parents[2].parent / "shared" / "data"))
    path = folder / name
    if not path.exists():
        if os.environ.get("CI") == "true":
            pytest.fail(f"{path} is missing; set WHERRY_DATA")
        pytest.skip(f"{path} is missing; set WHERRY_DATA")
    return path
