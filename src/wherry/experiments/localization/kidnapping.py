"""A robot that wanders about in the simulator, and is now and then picked up and put down somewhere else.

How precisely it is localized, whether it notices that it is lost, how soon it finds itself, and whether it ever raises
a false alarm. It wanders by its scans alone, so that where it goes does not depend on what it believes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from wherry.experiments.localization.reliability import Reliability
from wherry.floorplan.generation import place_boxes
from wherry.floorplan.plan import Cell, FloorPlan
from wherry.floorplan.world_files import find_world
from wherry.localization.localizer import Localization, Localizer
from wherry.localization.parameters import PRECISE
from wherry.navigation.controller import safe_velocity
from wherry.pipelines.logs.localization import LOST
from wherry.robot import Odometry, Scan, Velocity
from wherry.simulation import Simulation, build
from wherry.space.mapper import GridMapper
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose

RESOLUTION = 0.05  # m, of the map
MAPPING_VIEWS = 4  # headings that every cell is mapped from
CLOSE = np.diag([0.05**2, 0.05**2, 0.03**2])
FOUND = 0.3  # m, and
FOUND_HEADING = math.radians(15.0)  # : nearer to the truth than this the robot has found itself
SPEED = 0.4  # m/s
TURN = 1.2  # rad/s
ROOM = 0.45  # m, that must be clear ahead


@dataclass(frozen=True, slots=True)
class Settings:
    """What to run.

    Attributes:
        world: A built-in world's name, or a world file.
        boxes: Boxes that are not on the map.
        seed: Of everything that is random.
        seconds: s, simulated, of undisturbed wandering.
        kidnappings: How often the robot is then put somewhere else.
        patience: s, simulated, after each.
    """

    world: str = "rooms"
    boxes: int = 4
    seed: int = 0
    seconds: float = 3600.0
    kidnappings: int = 100
    patience: float = 25.0


@dataclass(frozen=True, slots=True)
class Sight:
    """One scan of the run.

    Attributes:
        time: s, simulated.
        found: Where the robot is believed to be.
        truth: Where it is.
        kidnapping: How many there have been.
    """

    time: float
    found: Localization
    truth: Pose
    kidnapping: int

    @property
    def error(self) -> float:
        """Distance from the truth, m."""
        return self.found.pose.distance_to(self.truth)

    @property
    def is_found(self) -> bool:
        """Whether the robot knows where it is."""
        return is_found(self.found.pose, self.truth)


def is_found(pose: Pose, truth: Pose) -> bool:
    """Whether a believed pose is so near to the true one that the robot is not lost."""
    return pose.is_near(truth, FOUND, FOUND_HEADING)


@dataclass(frozen=True, slots=True)
class Result:
    """What came out.

    Attributes:
        tracking_rmse_m: Of the undisturbed part.
        tracking_p99_m: 99th percentile of the errors there.
        false_alarms: How often the robot believed itself lost there.
        relocalizations: How often it started anew there.
        recovered: [K] s, from each kidnapping until the robot has found itself for good; inf if it has not.
        noticed: [K] s, from each kidnapping until it believed itself lost; inf if never.
        reliability: Of the lost probability.
    """

    tracking_rmse_m: float
    tracking_p99_m: float
    false_alarms: int
    relocalizations: int
    recovered: Floats
    noticed: Floats
    reliability: Reliability


def run(settings: Settings) -> Iterator[Sight]:
    """Wander; ask `summarize` for the result.

    Raises:
        InputError: The world cannot be used.
    """
    boxes_rng, world_rng, filter_rng, way_rng = np.random.default_rng(settings.seed).spawn(4)
    plan = place_boxes(find_world(settings.world), settings.boxes, boxes_rng)
    simulation = build(plan, world_rng)
    localizer = Localizer(true_map(plan), simulation.robot.body.lidar, PRECISE, filter_rng)
    localizer.initialize(simulation.physics.robot_pose, CLOSE)
    wanderer = Wanderer(way_rng)
    yield from _wander(simulation, localizer, wanderer, settings.seconds, kidnapping=0)
    for kidnapping in range(1, settings.kidnappings + 1):
        simulation.physics.place_robot(somewhere(plan, way_rng), None)
        yield from _wander(simulation, localizer, wanderer, settings.patience, kidnapping)


def _wander(
    simulation: Simulation, localizer: Localizer, wanderer: Wanderer, seconds: float, kidnapping: int
) -> Iterator[Sight]:
    robot = simulation.robot
    end = simulation.time + seconds
    odometry: Odometry | None = None
    while simulation.time < end:
        measurement = robot.receive()
        if isinstance(measurement, Odometry):
            odometry = measurement
        elif odometry is not None:
            truth = simulation.physics.robot_pose
            found = localizer.update(odometry, measurement)
            yield Sight(measurement.time, found, truth, kidnapping)
            robot.command(safe_velocity(wanderer.velocity(measurement), measurement, robot.body))


class Wanderer:
    """Drives ahead while there is room, and else turns until there is."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._turning = 0.0

    def velocity(self, scan: Scan) -> Velocity:
        """What to do, by the scan alone."""
        ahead = np.abs(scan.angles) < math.radians(35.0)
        room = float(np.min(np.where(scan.valid & ahead, scan.ranges, np.inf), initial=np.inf))
        if room > ROOM + (0.15 if self._turning else 0.0) and self._rng.random() > 0.02:
            self._turning = 0.0
            return Velocity(SPEED, 0.3 * float(self._rng.standard_normal()))
        self._turning = self._turning or float(self._rng.choice([-TURN, TURN]))
        return Velocity(0.0, self._turning)


def true_map(plan: FloorPlan) -> OccupancyGrid:
    """The map that a robot with a perfect memory of its way draws: scans from every cell, at the true poses."""
    empty = build(plan.with_boxes(()), np.random.default_rng(0))
    mapper = GridMapper(RESOLUTION)
    lidar_on_base = empty.robot.body.lidar
    nothing = np.empty((0, 2))
    for cell in reachable(plan):
        for view in range(MAPPING_VIEWS):
            lidar = _centre(plan, cell, view * math.tau / MAPPING_VIEWS) @ lidar_on_base
            scan = empty.lidar.scan(0.0, lidar, nothing, 0.1)
            ends = lidar.transform(scan.points())
            mapper.add(lidar.as_array()[:2], ends, np.ones(len(ends), np.bool_))
    return mapper.grid()


def reachable(plan: FloorPlan) -> list[Cell]:
    """The cells that the robot can get to."""
    return sorted(plan.distances(plan.start)) if plan.start is not None else []


def somewhere(plan: FloorPlan, rng: np.random.Generator) -> Pose:
    """A random pose in the middle of a reachable cell without a box."""
    cells = [cell for cell in reachable(plan) if cell not in plan.boxes]
    return _centre(plan, cells[int(rng.integers(len(cells)))], float(rng.uniform(-math.pi, math.pi)))


def _centre(plan: FloorPlan, cell: Cell, heading: float) -> Pose:
    return Pose(*plan.centre(cell), heading)


def summarize(sights: list[Sight]) -> Result:
    """The figures of a run."""
    undisturbed = [sight for sight in sights if not sight.kidnapping]
    errors = np.array([sight.error for sight in undisturbed] or [math.nan])
    alarms = np.array([sight.found.lost_probability > LOST for sight in undisturbed], np.bool_)
    trials = [[s for s in sights if s.kidnapping == k] for k in range(1, max(s.kidnapping for s in sights) + 1)]
    return Result(
        tracking_rmse_m=math.sqrt(float(np.mean(errors**2))),
        tracking_p99_m=float(np.quantile(errors, 0.99)),
        false_alarms=int(np.count_nonzero(alarms[1:] & ~alarms[:-1])),
        relocalizations=sum(bool(sight.found.hypotheses) for sight in undisturbed),
        recovered=np.array([_recovery(trial) for trial in trials]),
        noticed=np.array([_notice(trial) for trial in trials]),
        reliability=Reliability.of(
            np.array([sight.found.lost_probability for sight in sights]),
            np.array([not sight.is_found for sight in sights]),
        ),
    )


def _recovery(trial: list[Sight]) -> float:
    """How many s until the robot has found itself for good."""
    last = max((i for i, sight in enumerate(trial) if not sight.is_found), default=-1)
    return trial[last + 1].time - trial[0].time if last + 1 < len(trial) else math.inf


def _notice(trial: list[Sight]) -> float:
    """How many s until the robot believes itself lost."""
    return next((s.time - trial[0].time for s in trial if s.found.lost_probability > LOST), math.inf)
