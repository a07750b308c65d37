"""Tracking and kidnapping of a simulated robot among unmapped boxes.

Measures the precision of tracking, the number of false alarms, and the times until a kidnapping is detected and until
the robot is localized again.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from wherry.evaluation import root_mean_square
from wherry.experiments.localization.reliability import Reliability
from wherry.experiments.localization.wandering import RandomWalk, WanderingRobot
from wherry.floorplan.generation import place_boxes
from wherry.floorplan.world_files import find_world
from wherry.localization.localizer import Localization, Localizer
from wherry.localization.parameters import LOST_PROBABILITY_THRESHOLD, PRECISE_PARAMETERS
from wherry.simulation import build
from wherry.simulation.faults import random_cell_pose
from wherry.simulation.ground_truth import true_map
from wherry.space.pose import Floats, Pose

START_COVARIANCE = np.diag([0.05**2, 0.05**2, 0.03**2])  # m², m², rad², of the start pose
LOCALIZED_MAX_DISTANCE = 0.3  # m, distance from the true position below which the robot is localized
LOCALIZED_MAX_ANGLE = math.radians(15.0)  # rad, deviation from the true heading below which the robot is localized


@dataclass(frozen=True, slots=True)
class KidnappingSettings:
    """Inputs of a kidnapping run.

    Attributes:
        world: Name of a built-in world, or path of a world file.
        boxes: Number of unmapped boxes.
        seed: Seed of all randomness.
        tracking_seconds: Simulated time of wandering before the first kidnapping, s.
        kidnappings: Number of kidnappings.
        seconds_per_kidnapping: Simulated time of wandering after each kidnapping, s.
    """

    world: str = "rooms"
    boxes: int = 4
    seed: int = 0
    tracking_seconds: float = 3600.0
    kidnappings: int = 100
    seconds_per_kidnapping: float = 25.0


@dataclass(frozen=True, slots=True)
class EvaluatedScan:
    """One localized scan with the ground truth.

    Attributes:
        time: Simulated time of the scan, s.
        localization: Estimated pose and its reliability.
        truth: True pose of base_link, map frame.
        kidnapping: Number of kidnappings before the scan.
    """

    time: float
    localization: Localization
    truth: Pose
    kidnapping: int

    @property
    def error(self) -> float:
        """Distance of the estimated from the true position, m."""
        return self.localization.pose.distance_to(self.truth)

    @property
    def is_localized(self) -> bool:
        """Whether the estimated pose is close to the true one."""
        return is_localized(self.localization.pose, self.truth)

    @property
    def is_reported_lost(self) -> bool:
        """Whether the localizer reports that the robot is lost."""
        return self.localization.lost_probability > LOST_PROBABILITY_THRESHOLD


def is_localized(pose: Pose, truth: Pose) -> bool:
    """Whether an estimated pose is close to the true one, so that the robot is not lost."""
    return pose.is_near(truth, LOCALIZED_MAX_DISTANCE, LOCALIZED_MAX_ANGLE)


@dataclass(frozen=True, slots=True)
class KidnappingResult:
    """Metrics of a kidnapping run.

    Attributes:
        tracking_rmse_m: Root mean square position error before the first kidnapping, m.
        tracking_p99_m: 99th percentile of the position errors before the first kidnapping, m.
        false_alarms: Number of times that the robot reported itself lost before the first kidnapping.
        relocalizations: Number of relocalizations before the first kidnapping.
        recovery_seconds: [K] s, time from each kidnapping until the robot is localized and stays so; inf if it is not.
        detection_seconds: [K] s, time from each kidnapping until the robot reports itself lost; inf if it does not.
        reliability: Reliability of the probability of being lost.
    """

    tracking_rmse_m: float
    tracking_p99_m: float
    false_alarms: int
    relocalizations: int
    recovery_seconds: Floats
    detection_seconds: Floats
    reliability: Reliability


def run(settings: KidnappingSettings) -> Iterator[EvaluatedScan]:
    """Let the robot wander and kidnap it repeatedly, yielding every scan; `summarize` computes the metrics.

    Raises:
        InputError: The world cannot be used.
    """
    boxes_rng, world_rng, filter_rng, path_rng = np.random.default_rng(settings.seed).spawn(4)
    plan = place_boxes(find_world(settings.world), settings.boxes, boxes_rng)
    simulation = build(plan, world_rng)
    localizer = Localizer(true_map(plan), simulation.robot.body.lidar, PRECISE_PARAMETERS, filter_rng)
    localizer.initialize(simulation.physics.robot_pose, START_COVARIANCE)
    walk = RandomWalk(path_rng)
    for kidnapping in range(settings.kidnappings + 1):
        if kidnapping:
            simulation.physics.place_robot(random_cell_pose(plan, path_rng), None)
        seconds = settings.seconds_per_kidnapping if kidnapping else settings.tracking_seconds
        robot = WanderingRobot(simulation, walk)
        for odometry, scan, truth in robot.measurements(simulation.time + seconds):
            yield EvaluatedScan(scan.time, localizer.update(odometry, scan), truth, kidnapping)


def summarize(scans: list[EvaluatedScan]) -> KidnappingResult:
    """Compute the metrics of the scans of a run."""
    tracked = [scan for scan in scans if not scan.kidnapping]
    errors = np.array([scan.error for scan in tracked] or [math.nan])
    alarms = np.array([scan.is_reported_lost for scan in tracked], np.bool_)
    kidnappings = range(1, max(scan.kidnapping for scan in scans) + 1)
    trials = [[scan for scan in scans if scan.kidnapping == number] for number in kidnappings]
    return KidnappingResult(
        tracking_rmse_m=root_mean_square(errors),
        tracking_p99_m=float(np.quantile(errors, 0.99)),
        false_alarms=int(np.count_nonzero(alarms[1:] & ~alarms[:-1])),
        relocalizations=sum(bool(scan.localization.hypotheses) for scan in tracked),
        recovery_seconds=np.array([_recovery_seconds(trial) for trial in trials]),
        detection_seconds=np.array([_detection_seconds(trial) for trial in trials]),
        reliability=Reliability.of(
            np.array([scan.localization.lost_probability for scan in scans]),
            np.array([not scan.is_localized for scan in scans]),
        ),
    )


def _recovery_seconds(trial: list[EvaluatedScan]) -> float:
    """Time until the robot is localized and stays so, s; inf if it is not."""
    last_lost = max((index for index, scan in enumerate(trial) if not scan.is_localized), default=-1)
    return trial[last_lost + 1].time - trial[0].time if last_lost + 1 < len(trial) else math.inf


def _detection_seconds(trial: list[EvaluatedScan]) -> float:
    """Time until the robot reports itself lost, s; inf if it does not."""
    return next((scan.time - trial[0].time for scan in trial if scan.is_reported_lost), math.inf)
