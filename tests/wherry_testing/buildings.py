"""A building of several rooms and a robot that drives through it, for the tests of mapping."""

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

RESOLUTION = 0.02
BEAMS = 360
RANGE_MAX = 12.0
LIDAR = Pose(-0.15, 0.0, 0.0)


def building() -> NDArray[np.bool_]:
    """12 × 8 m at 2 cm: two rooms over a corridor and two below it, all different, with doors."""
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
        scans: N of them.
        odometry: N, drifting.
        truth: [N, 3] base_link relative to the first pose.
        start: The first pose, in the building's frame.
    """

    scans: list[Scan]
    odometry: list[Odometry]
    truth: Floats
    start: Pose


WAY = [
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
WAY += [(10.4, 4.0), (2.4, 4.0), (2.4, 2.4)]


ROOMS, ROOM = 6, 5.0  # on each side of the long corridor; m from one to the next


def alike() -> NDArray[np.bool_]:
    """30 × 12 m at 2 cm: a corridor of 30 m between rooms that are all the same, the same to the left as to the right.

    Only its ends tell where along it one is, and a lidar sees them from near them only.
    """
    room = round(ROOM / RESOLUTION)
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


def way_along_alike(visits: Sequence[tuple[int, int]]) -> list[tuple[float, float]]:
    """Up and down the corridor of `alike` and into rooms on the way: number, and 1 for above or -1 for below."""
    way = [(1.0, 6.0)]
    for number, side in visits:
        door = ROOM * number + 2.5
        way += [(door, 6.0), (door, 6.0 + 3.5 * side), (door, 6.0)]
    return [*way, (1.0, 6.0)]


def drive(
    noise: float = 0.0,
    drift: float = 0.0,
    seed: int = 0,
    spacing: float = 0.1,
    *,
    blocked: NDArray[np.bool_] | None = None,
    way: Sequence[tuple[float, float]] = WAY,
    range_max: float = RANGE_MAX,
) -> Drive:
    """Drive along a way through a building.

    Args:
        noise: m, σ of the ranges.
        drift: Share by which odometry is wrong, systematically and at random.
        seed: Of the noise.
        spacing: m between scans.
        blocked: [H, W] the building; None for `building`.
        way: m, from place to place.
        range_max: m that the lidar sees.
    """
    rng = np.random.default_rng(seed)
    truth = list(_poses(way, spacing))
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


def _poses(way: Sequence[tuple[float, float]], spacing: float) -> Iterator[Pose]:
    """The poses on the way: straight on, and turning on the spot in steps of 5°."""
    heading = math.pi / 2.0
    for (x, y), (next_x, next_y) in itertools.pairwise(way):
        bearing = math.atan2(next_y - y, next_x - x)
        turn = math.remainder(bearing - heading, math.tau)
        for share in np.linspace(0.0, 1.0, max(round(abs(turn) / math.radians(5.0)), 1), endpoint=False):
            yield Pose(x, y, heading + share * turn)
        heading = bearing
        for share in np.linspace(0.0, 1.0, round(math.hypot(next_x - x, next_y - y) / spacing), endpoint=False):
            yield Pose(x + share * (next_x - x), y + share * (next_y - y), heading)
    yield Pose(*way[-1], heading)


def wall_distances(grid: OccupancyGrid, start: Pose, walls: NDArray[np.bool_]) -> Floats:
    """[N] m, from each occupied cell's middle to the nearest wall."""
    away = ndimage.distance_transform_edt(~walls) * RESOLUTION
    cells = np.floor(start.transform(grid.occupied_points()) / RESOLUTION).astype(np.int64)
    columns, rows = np.clip(cells[:, 0], 0, walls.shape[1] - 1), np.clip(cells[:, 1], 0, walls.shape[0] - 1)
    distances: Floats = away[rows, columns]
    return distances


def shared_data(name: str) -> Path:
    """A file of the shared data; skips where there is none, except in CI."""
    folder = Path(os.environ.get("WHERRY_DATA", Path(__file__).parents[2].parent / "shared" / "data"))
    path = folder / name
    if not path.exists():
        if os.environ.get("CI") == "true":
            pytest.fail(f"{path} is missing; set WHERRY_DATA")
        pytest.skip(f"{path} is missing; set WHERRY_DATA")
    return path
