"""Accuracy and speed of mapping while a simulated robot explores a world."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wherry.evaluation import position_errors, root_mean_square
from wherry.experiments.results import markdown_table
from wherry.floorplan.plan import FloorPlan
from wherry.floorplan.world_files import find_world
from wherry.mapping.graph_slam import GraphSlam
from wherry.realization.mission import Mission, order_from_plan
from wherry.realization.pose_estimators import SlamPoseEstimator
from wherry.realization.pose_tracker import PoseEstimator
from wherry.robot import Odometry, Scan
from wherry.simulation import build
from wherry.simulation.seeded_worlds import seed_world
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import IDENTITY, Pose
from wherry.trace.records import null_sink

WORLD = "rooms"  # default world of `wherry deliver`
WARM_UP_WORLD = "small"  # the smallest built-in world


@dataclass(frozen=True, slots=True)
class ExplorationResult:
    """Errors and speed of one map.

    Attributes:
        world: Name of the world.
        seed: Seed of the boxes' positions, of the sensors' noise and of the odometry's drift.
        scans: Number of scans.
        wall_error_m: Median distance of the map's occupied cells from the true walls, m, with the map placed by the
            robot's true first pose.
        rmse_m: Root mean square error of the poses at the time of each scan, m, with the map placed by the robot's
            true first pose.
        ms_per_scan_median: Median processor time of a scan, ms.
        times_real_time: Duration of the drive over the processor time of its scans and maps.
    """

    world: str
    seed: int
    scans: int
    wall_error_m: float
    rmse_m: float
    ms_per_scan_median: float
    times_real_time: float


class TimedMapper:
    """Graph SLAM as a `wherry.realization.mission.Mapper` that measures its processor time.

    Args:
        lidar: Pose of the lidar in the base_link frame.

    Attributes:
        start: base_link in the map frame at the robot's start.
        times: Time of each scan on the robot's clock, s.
        poses: base_link in the map frame at each scan, by the estimate at that time.
        scan_seconds: Processor time of each scan, s.
        map_seconds: Processor time of all maps, s.
    """

    def __init__(self, lidar: Pose) -> None:
        self._slam = GraphSlam(lidar)
        self._estimator = SlamPoseEstimator(self._slam)
        self.start = IDENTITY
        self.times: list[float] = []
        self.poses: list[Pose] = []
        self.scan_seconds: list[float] = []
        self.map_seconds = 0.0

    @property
    def pose_estimator(self) -> PoseEstimator:
        """This object, which measures the time of the estimator's updates."""
        return self

    @property
    def particles(self) -> NDArray[np.float64]:
        """As `SlamPoseEstimator.particles`."""
        return self._estimator.particles

    @property
    def is_lost(self) -> bool:
        """As `SlamPoseEstimator.is_lost`."""
        return self._estimator.is_lost

    def update(self, odometry: Odometry, scan: Scan) -> Pose:
        """As `SlamPoseEstimator.update`."""
        before = time.thread_time()
        pose = self._estimator.update(odometry, scan)
        self.scan_seconds.append(time.thread_time() - before)
        self.times.append(scan.time)
        self.poses.append(pose)
        return pose

    def resume(self, pose: Pose) -> None:
        """As `SlamPoseEstimator.resume`."""
        self._estimator.resume(pose)

    def grid(self) -> OccupancyGrid:
        """The map so far."""
        before = time.thread_time()
        grid = self._slam.grid()
        self.map_seconds += time.thread_time() - before
        return grid


def warm_up() -> None:
    """Explore a small world, so that all kernels are compiled before times are measured."""
    explore(find_world(WARM_UP_WORLD), 0)


def explore(plan: FloorPlan, seed: int) -> ExplorationResult:
    """Explore a world with boxes, and compare the map and the poses with the ground truth.

    Args:
        plan: The world.
        seed: Seed of all randomness.
    """
    world = seed_world(plan, None, seed)
    simulation = build(world.plan, world.physics_rng)
    world_from_map = simulation.physics.robot_pose
    mapper = TimedMapper(simulation.robot.body.lidar)
    ready = Mission(
        simulation.robot, order_from_plan(world.plan), null_sink, world.robot_rng, mapper=lambda _: mapper
    ).explore()
    walls = world_from_map.transform(ready.grid.occupied_points())
    history = simulation.referee.trajectory
    true = history[np.searchsorted(history[:, 0], np.array(mapper.times) - 1e-6), 1:]
    estimated = np.array([pose.as_array() for pose in mapper.poses])
    spent = sum(mapper.scan_seconds) + mapper.map_seconds
    return ExplorationResult(
        world=plan.name,
        seed=seed,
        scans=len(mapper.times),
        wall_error_m=float(np.median(simulation.referee.wall_distance(walls))),
        rmse_m=root_mean_square(position_errors(estimated, true, world_from_map)),
        ms_per_scan_median=1e3 * float(np.median(mapper.scan_seconds)),
        times_real_time=(mapper.times[-1] - mapper.times[0]) / spent,
    )


def table(results: Sequence[ExplorationResult]) -> str:
    """A Markdown table with one row per run."""
    header = ["world", "seed", "scans", "median wall error, cm", "pose rmse, cm", "ms per scan", "× real time"]
    rows = [
        [
            result.world,
            str(result.seed),
            str(result.scans),
            f"{1e2 * result.wall_error_m:.1f}",
            f"{1e2 * result.rmse_m:.1f}",
            f"{result.ms_per_scan_median:.2f}",
            f"{result.times_real_time:.0f}",
        ]
        for result in results
    ]
    return markdown_table(header, rows)
