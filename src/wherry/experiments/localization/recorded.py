"""Localization on recorded logs: the odd scans of the Intel log on the map of the even ones, and Wean Hall globally."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wherry.experiments.localization.kidnapping import is_localized
from wherry.localization.localizer import Localizer
from wherry.localization.parameters import KNOWN_START_COVARIANCE, LOG_PARAMETERS, LOST_PROBABILITY_THRESHOLD
from wherry.localization.relocalization import Relocalizer
from wherry.logs.reading import read_log
from wherry.logs.timestamps import increasing_times
from wherry.mapping.graph_slam import GraphSlam
from wherry.pipelines.logs.localization import LocalizationSettings, odometry_of_scans, prepare
from wherry.robot import Odometry, Scan, Velocity
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose
from wherry.space.trajectory import Trajectory

INTEL = Path("intel/intel_910_rawodom.clf.gz")  # below the folder of recorded logs
WEAN_MAP = Path("wean/wean.dat.gz")
WEAN_LOGS = tuple(Path(f"wean/robotdata{number}.log.gz") for number in (1, 2, 3))
CORRECT_MAX_DISTANCE = 0.5  # m, distance from the reference below which a pose is correct
KIDNAPPING_SECONDS = 3.0  # s, duration of a kidnapping
SEGMENT_SCANS = 40  # scans that are played after a kidnapping
KIDNAPPING_MIN_DISTANCE = 3.0  # m, minimum distance over which a robot is kidnapped


@dataclass(frozen=True)
class GroundTruthLog:
    """Scans with odometry and true poses.

    Attributes:
        scans: [N] scans in order of time.
        odometry: [N] poses of base_link, odom frame.
        poses: [N, 3] m, m, rad, true poses of base_link, map frame.
    """

    scans: tuple[Scan, ...]
    odometry: tuple[Pose, ...]
    poses: Floats


@dataclass(frozen=True)
class SplitLog:
    """A log whose even scans are mapped, and whose odd scans are localized on the map.

    Attributes:
        grid: Map of the even scans.
        lidar: Pose of the lidar, base_link frame.
        odd: The odd scans; their poses are interpolated by odometry between the even scans' poses from SLAM.
    """

    grid: OccupancyGrid
    lidar: Pose
    odd: GroundTruthLog


@dataclass(frozen=True, slots=True)
class TrackingResult:
    """Metrics of tracking the odd scans from a known start and, after a kidnapping, another segment of them.

    Attributes:
        median_m: Median distance from the reference before the kidnapping, m.
        p99_m: 99th percentile of the distances from the reference before the kidnapping, m.
        incorrect_fraction: Fraction of the scans before the kidnapping whose estimate is not correct.
        lost_fraction: Fraction of the scans before the kidnapping at which the robot was reported lost.
        lost_probabilities: [M] stated probability of being lost at every scan, also those after the kidnapping.
        is_lost: [M] whether the robot was lost at every scan, also those after the kidnapping.
    """

    median_m: float
    p99_m: float
    incorrect_fraction: float
    lost_fraction: float
    lost_probabilities: Floats
    is_lost: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class SingleScanResult:
    """Metrics of relocalizing odd scans, each by itself, on the whole map.

    Attributes:
        scans: Number of scans.
        correct_fraction: Fraction of the scans whose best hypothesis is within CORRECT_MAX_DISTANCE of the reference.
        ambiguous_fraction: Fraction of the scans whose relocalization was ambiguous.
        correct_or_ambiguous_fraction: Fraction of the scans with a correct best hypothesis or an ambiguous result.
        seconds_median: Median processor time of a scan, s.
        seconds_max: Largest processor time of a scan, s.
    """

    scans: int
    correct_fraction: float
    ambiguous_fraction: float
    correct_or_ambiguous_fraction: float
    seconds_median: float
    seconds_max: float


def split_log(path: Path) -> SplitLog:
    """Map the even scans of a log, and interpolate the poses of the odd ones.

    Raises:
        InputError: The log cannot be read, or has scans without odometry.
    """
    log = read_log(path)
    odometry = odometry_of_scans(log, path)
    slam = GraphSlam(log.lidar)
    for scan, reading in list(zip(log.scans, odometry, strict=True))[::2]:
        slam.add(scan, reading)
    slam.finish()
    driven = Trajectory(
        np.array([reading.time for reading in odometry]), np.array([reading.pose.as_array() for reading in odometry])
    )
    scans = log.scans[1::2]
    poses = slam.trajectory.at(np.array([scan.time for scan in scans]), driven)
    odd = GroundTruthLog(scans, tuple(reading.pose for reading in odometry[1::2]), poses)
    return SplitLog(slam.grid(), log.lidar, odd)


def play_segments(log: GroundTruthLog, segments: Sequence[range]) -> Iterator[tuple[Odometry, Scan, Pose]]:
    """Play segments of a log, as if the robot were kidnapped from the end of each to the start of the next.

    Args:
        log: The log.
        segments: Ranges of indices of scans.

    Yields:
        Odometry and scan, whose time continues from segment to segment, and the true pose of base_link, map frame.
    """
    times = increasing_times(np.array([scan.time for scan in log.scans]))
    at, odometry = 0.0, Pose()
    for segment in segments:
        for index in segment:
            if index == segment.start:
                at += KIDNAPPING_SECONDS
            else:
                at += float(times[index] - times[index - 1])
                odometry @= log.odometry[index].relative_to(log.odometry[index - 1])
            truth = Pose.from_array(log.poses[index])
            yield Odometry(at, odometry, Velocity()), replace(log.scans[index], time=at), truth


def track(data: SplitLog, seed: int) -> TrackingResult:
    """Localize all odd scans from a known start, and then a segment after a kidnapping."""
    length = len(data.odd.scans)
    rng, kidnapping_rng = np.random.default_rng(seed), np.random.default_rng((seed, 1))
    localizer = Localizer(data.grid, data.lidar, LOG_PARAMETERS, rng)
    localizer.initialize(Pose.from_array(data.odd.poses[0]), KNOWN_START_COVARIANCE)
    errors, probabilities, is_lost = [], [], []
    kidnapped = distant_segment(data.odd, length - 1, kidnapping_rng)
    for odometry, scan, truth in play_segments(data.odd, [range(length), kidnapped]):
        localization = localizer.update(odometry, scan)
        errors.append(localization.pose.distance_to(truth))
        probabilities.append(localization.lost_probability)
        is_lost.append(not is_localized(localization.pose, truth))
    tracked, stated = np.array(errors[:length]), np.array(probabilities[:length])
    return TrackingResult(
        median_m=float(np.median(tracked)),
        p99_m=float(np.quantile(tracked, 0.99)),
        incorrect_fraction=float(np.mean(tracked > CORRECT_MAX_DISTANCE)),
        lost_fraction=float(np.mean(stated > LOST_PROBABILITY_THRESHOLD)),
        lost_probabilities=np.array(probabilities),
        is_lost=np.array(is_lost),
    )


def distant_segment(log: GroundTruthLog, index: int, rng: np.random.Generator) -> range:
    """A random segment of a log that starts far away from the true position of the scan at an index."""
    distance = np.hypot(*(log.poses[:, :2] - log.poses[index, :2]).T)
    starts = np.flatnonzero(distance[: len(distance) - SEGMENT_SCANS] > KIDNAPPING_MIN_DISTANCE)
    start = int(rng.choice(starts))
    return range(start, start + SEGMENT_SCANS)


def relocalize(data: SplitLog, every: int = 1) -> SingleScanResult:
    """Relocalize every ``every``-th odd scan by itself, after a search that only compiles the kernels."""
    relocalizer = Relocalizer(data.grid, data.lidar, LOG_PARAMETERS)
    relocalizer.search(data.odd.scans[0])
    correct, ambiguous, seconds = [], [], []
    for scan, truth in list(zip(data.odd.scans, data.odd.poses, strict=True))[::every]:
        before = time.thread_time()
        result = relocalizer.search(scan)
        seconds.append(time.thread_time() - before)
        best = result.hypotheses[0].pose if result.hypotheses else None
        correct.append(best is not None and best.distance_to(Pose.from_array(truth)) < CORRECT_MAX_DISTANCE)
        ambiguous.append(result.is_ambiguous)
    return SingleScanResult(
        scans=len(seconds),
        correct_fraction=float(np.mean(correct)),
        ambiguous_fraction=float(np.mean(ambiguous)),
        correct_or_ambiguous_fraction=float(np.mean(np.logical_or(correct, ambiguous))),
        seconds_median=float(np.median(seconds)),
        seconds_max=max(seconds),
    )


def final_poses(log: Path, map_file: Path, seeds: range) -> Iterator[Floats]:
    """Final poses [3] m, m, rad, map frame, of global localization with each seed.

    Raises:
        InputError: Log or map cannot be read.
    """
    for seed in seeds:
        run = prepare(LocalizationSettings(log, map_file, is_global=True, seed=seed))
        for _ in run.steps():
            pass
        yield np.array(run.result().final_pose)


def largest_group(poses: Floats) -> int:
    """Largest number of the poses [N, 3] m, m, rad that are within CORRECT_MAX_DISTANCE of one of them."""
    distance = np.hypot(*(poses[:, None, :2] - poses[None, :, :2]).transpose(2, 0, 1))
    return int((distance < CORRECT_MAX_DISTANCE).sum(axis=1).max())
