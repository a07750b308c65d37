"""Processor time of a particle filter update and of building a likelihood field."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from wherry.floorplan.world_files import find_world
from wherry.localization.amcl import Amcl
from wherry.localization.parameters import AmclParameters
from wherry.localization.sensor import log_likelihood
from wherry.robot import Odometry, Scan, Velocity
from wherry.simulation.ground_truth import true_map
from wherry.space.distance_field import DistanceField
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import IDENTITY, Floats, Pose
from wherry.space.raycast import cast_rays

PARTICLE_COUNTS = (2_000, 20_000, 100_000)
BEAMS = 360  # beams of a scan; the filter's sensor model uses 60 of them by default, and its scan match all
MAX_RANGE = 12.0  # m, maximum range of the lidar
STEP = 0.02  # m, distance from one scan to the next
WARM_UP_UPDATES = 3  # updates that are not counted, since the first ones compile the kernels
FIELD_SIDE = 100.0  # m, side of the map of the likelihood field
RESOLUTION = 0.05  # m, side of the cells of the likelihood field
OBSTACLE_FRACTION = 0.02  # fraction of the cells that are obstacles in the map of the likelihood field
FIELD_REPETITIONS = 4  # likelihood fields that are built, of which the first compiles the kernels and is not counted


@dataclass(frozen=True, slots=True)
class TaskTime:
    """Processor time of one task.

    Attributes:
        task: Description of the task.
        milliseconds: Median processor time, ms.
    """

    task: str
    milliseconds: float


def measure(updates: int = 60, side: float = FIELD_SIDE) -> Iterator[TaskTime]:
    """Measure all tasks.

    Args:
        updates: Number of measured filter updates.
        side: Side of the map of the likelihood field, m.
    """
    grid = true_map(find_world("rooms"))
    poses, scans = straight_drive(grid, updates + WARM_UP_UPDATES, STEP, BEAMS)
    for count in PARTICLE_COUNTS:
        for refine in (False, True):
            parameters = AmclParameters(
                min_particles=count,
                max_particles=count,
                update_min_d=0.0,
                update_min_a=0.0,
                refine=refine,
                initial_pose=poses[0],
            )
            suffix = ", matched to the map" if refine else ""
            task = f"an update of {count:,} particles with {parameters.max_beams} beams{suffix}"
            yield TaskTime(task, _update_milliseconds(grid, parameters, poses, scans))
    yield TaskTime(f"the likelihood field of {side:.0f} × {side:.0f} m at {RESOLUTION} m", _field_milliseconds(side))


def straight_drive(grid: OccupancyGrid, count: int, step: float, beams: int) -> tuple[list[Pose], list[Floats]]:
    """Poses and scans along the row of the map with the most free cells.

    Args:
        grid: The map.
        count: Number of scans.
        step: Distance from one scan to the next, m.
        beams: Number of beams of each scan, see `beam_angles`.

    Returns:
        [count] poses of the lidar, map frame, and [count] ranges [beams] m.
    """
    row = int(np.argmax(grid.free.sum(axis=1)))
    first = int(np.flatnonzero(grid.free[row])[0]) + 10
    positions = [
        ((first + 0.5) * grid.resolution + step * number, (row + 0.5) * grid.resolution) for number in range(count)
    ]
    poses = [grid.origin @ Pose(x, y) for x, y in positions]
    table = np.array([pose.as_array() for pose in poses])
    return poses, list(cast_rays(grid.occupied, grid.resolution, grid.origin, table, beam_angles(beams), MAX_RANGE))


def beam_angles(beams: int) -> Floats:
    """[B] rad, lidar frame, angles of beams that are evenly spaced over a full turn from −π."""
    angles: Floats = -math.pi + math.tau / beams * np.arange(beams, dtype=np.float64)
    return angles


def _update_milliseconds(
    grid: OccupancyGrid, parameters: AmclParameters, poses: list[Pose], scans: list[Floats]
) -> float:
    """Median processor time of a filter update, ms."""
    amcl = Amcl(grid, IDENTITY, parameters, np.random.default_rng(0))
    seconds = []
    for number, (pose, ranges) in enumerate(zip(poses, scans, strict=True)):
        scan = Scan(0.1 * number, ranges, -math.pi, math.tau / BEAMS, 0.05, MAX_RANGE + 1.0)
        odometry = Odometry(0.1 * number, pose, Velocity())
        before = time.thread_time()
        amcl.update(odometry, scan)
        seconds.append(time.thread_time() - before)
    return 1e3 * float(np.median(seconds[WARM_UP_UPDATES:]))


def _field_milliseconds(side: float) -> float:
    """Median processor time of computing the likelihood field of a random map, ms."""
    cells = round(side / RESOLUTION)
    occupied = np.random.default_rng(0).random((cells, cells)) < OBSTACLE_FRACTION
    grid = OccupancyGrid(np.where(occupied, np.float32(0.9), np.float32(0.1)), RESOLUTION)
    parameters = AmclParameters()
    seconds = []
    for _ in range(FIELD_REPETITIONS):
        before = time.thread_time()
        distances = DistanceField.of(grid, parameters.laser_likelihood_max_dist)
        log_likelihood(distances.distance, MAX_RANGE, parameters)
        seconds.append(time.thread_time() - before)
    return 1e3 * float(np.median(seconds[1:]))
