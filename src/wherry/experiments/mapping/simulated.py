"""A simulated robot explores a world and maps it by itself: how true the walls are, and how fast the mapping is."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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

WORLD = "rooms"  # the one that `wherry deliver` takes by default
WARM_UP = "small"


@dataclass(frozen=True, slots=True)
class Result:
    """A world mapped once.

    Attributes:
        world: Its name.
        seed: Of the boxes' places, the sensors' noise and the odometry's drift.
        scans: How many were mapped.
        wall_error_m: Median distance of the map's occupied cells from the true walls, the map laid on the world by the
            robot's true first pose alone.
        rmse_m: Of the map's poses while the map was made, likewise.
        ms_per_scan_median: Of processor time.
        times_real_time: How long the robot drove, ÷ the processor time that its scans and maps took.
    """

    world: str
    seed: int
    scans: int
    wall_error_m: float
    rmse_m: float
    ms_per_scan_median: float
    times_real_time: float


class TimedMapper:
    """Our own SLAM as `wherry.realization.mission.Mapper`, with what it costs.

    Args:
        lidar: The lidar's pose, base_link frame.

    Attributes:
        times: s of the robot's clock, of each scan.
        poses: base_link in the map frame, as known at that time.
        scan_seconds: Processor time of each scan.
        map_seconds: Likewise, of all maps that were asked for.
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
        """Itself."""
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
    """Explore the smallest world, so that every kernel is compiled before a clock runs."""
    explore(find_world(WARM_UP), 0)


def explore(plan: FloorPlan, seed: int) -> Result:
    """Have a robot explore a world with boxes in it, and hold its map against the truth.

    Args:
        plan: The world.
        seed: Of all that is random.
    """
    world = seed_world(plan, None, seed)
    simulation = build(world.plan, world.physics_rng)
    world_from_map = simulation.physics.robot_pose
    mapper = TimedMapper(simulation.robot.body.lidar)
    ready = Mission(
        simulation.robot, order_from_plan(world.plan), null_sink, world.robot_rng, mapper=lambda _: mapper
    ).explore()
    walls = world_from_map.transform(ready.grid.occupied_points())
    history = simulation.referee.history
    true = history[np.searchsorted(history[:, 0], np.array(mapper.times) - 1e-6), 1:]
    found = world_from_map.transform(np.array([pose.as_array()[:2] for pose in mapper.poses]))
    spent = sum(mapper.scan_seconds) + mapper.map_seconds
    return Result(
        world=plan.name,
        seed=seed,
        scans=len(mapper.times),
        wall_error_m=float(np.median(simulation.referee.wall_distance(walls))),
        rmse_m=float(np.sqrt(((found - true[:, :2]) ** 2).sum(axis=1).mean())),
        ms_per_scan_median=1e3 * float(np.median(mapper.scan_seconds)),
        times_real_time=(mapper.times[-1] - mapper.times[0]) / spent,
    )


def table(results: Sequence[Result]) -> str:
    """A row a run, as Markdown."""
    header = ["world", "seed", "scans", "median wall error, cm", "pose rmse, cm", "ms a scan", "× real time"]
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
