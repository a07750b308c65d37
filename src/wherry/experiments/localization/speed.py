"""What an update of the particle filter and a map's likelihood field cost, in time of a core."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from wherry.experiments.localization.kidnapping import true_map
from wherry.floorplan.world_files import find_world
from wherry.localization.amcl import Amcl
from wherry.localization.parameters import AmclParameters
from wherry.localization.sensor import log_likelihood
from wherry.robot import Odometry, Scan, Velocity
from wherry.space.distance_field import DistanceField
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import IDENTITY, Floats, Pose
from wherry.space.raycast import cast_rays

COUNTS = (2_000, 20_000, 100_000)  # particles
BEAMS = 360  # of a scan; the filter weighs max_beams of them, 60 by default, and matches all
RANGE = 12.0  # m
STEP = 0.02  # m, from one scan to the next
FIRST = 3  # updates that are not counted: they compile
FIELD_SIDE = 100.0  # m
RESOLUTION = 0.05  # m
OBSTACLES = 0.02  # share of that map's cells


@dataclass(frozen=True, slots=True)
class Speed:
    """How long one thing takes.

    Attributes:
        task: What.
        milliseconds: The median.
    """

    task: str
    milliseconds: float


def measure(updates: int = 60, side: float = FIELD_SIDE) -> Iterator[Speed]:
    """Measure everything.

    Args:
        updates: Scans of the robot's drive.
        side: m, of the map whose likelihood field is made.
    """
    grid = true_map(find_world("rooms"))
    poses, scans = drive(grid, updates + FIRST, STEP, BEAMS)
    for count in COUNTS:
        for refine in (False, True):
            parameters = AmclParameters(
                min_particles=count, max_particles=count, update_min_d=0.0, update_min_a=0.0, refine=refine,
                initial_pose=poses[0],
            )  # fmt: skip
            told = ", matched to the map" if refine else ""
            task = f"an update of {count:,} particles with {parameters.max_beams} beams{told}"
            yield Speed(task, _update(grid, parameters, poses, scans))
    yield Speed(f"the likelihood field of {side:.0f} × {side:.0f} m at {RESOLUTION} m", _field(side))


def drive(grid: OccupancyGrid, count: int, step: float, beams: int) -> tuple[list[Pose], list[Floats]]:
    """A robot that drives along the longest row of free cells, and what its lidar measures, from one end on.

    Args:
        grid: The map.
        count: Scans.
        step: m, from one to the next.
        beams: Of each scan, in `angles_of`.
    """
    row = int(np.argmax(grid.free.sum(axis=1)))
    first = int(np.flatnonzero(grid.free[row])[0]) + 10
    at = [((first + 0.5) * grid.resolution + step * number, (row + 0.5) * grid.resolution) for number in range(count)]
    poses = [grid.origin @ Pose(x, y) for x, y in at]
    table = np.array([pose.as_array() for pose in poses])
    return poses, list(cast_rays(grid.occupied, grid.resolution, grid.origin, table, angles_of(beams), RANGE))


def angles_of(beams: int) -> Floats:
    """[B] rad, lidar frame: beams all around, the first one backwards."""
    angles: Floats = -math.pi + math.tau / beams * np.arange(beams, dtype=np.float64)
    return angles


def _update(grid: OccupancyGrid, parameters: AmclParameters, poses: list[Pose], scans: list[Floats]) -> float:
    amcl = Amcl(grid, IDENTITY, parameters, np.random.default_rng(0))
    taken = []
    for number, (pose, ranges) in enumerate(zip(poses, scans, strict=True)):
        scan = Scan(0.1 * number, ranges, -math.pi, math.tau / BEAMS, 0.05, RANGE + 1.0)
        odometry = Odometry(0.1 * number, pose, Velocity())
        began = time.thread_time()
        amcl.update(odometry, scan)
        taken.append(time.thread_time() - began)
    return 1e3 * float(np.median(taken[FIRST:]))


def _field(side: float) -> float:
    """The distances, and the logarithms of the likelihoods of readings that end there."""
    cells = round(side / RESOLUTION)
    occupied = np.random.default_rng(0).random((cells, cells)) < OBSTACLES
    grid = OccupancyGrid(np.where(occupied, np.float32(0.9), np.float32(0.1)), RESOLUTION)
    parameters = AmclParameters()
    taken = []
    for _ in range(4):
        began = time.thread_time()
        distances = DistanceField.of(grid, parameters.laser_likelihood_max_dist)
        log_likelihood(distances.distance, RANGE, parameters)
        taken.append(time.thread_time() - began)
    return 1e3 * float(np.median(taken[1:]))
