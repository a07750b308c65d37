"""Localization of real robots: half of the Intel log on the map of the other half, Wean Hall from anywhere."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wherry.errors import InputError
from wherry.experiments.localization import LOG_PARAMETERS, LOST, START_COVARIANCE, Settings, prepare
from wherry.localization.localizer import Localizer
from wherry.localization.relocalization import Relocalizer
from wherry.logs import LidarLog, read_log
from wherry.mapping.graph_slam import GraphSlam
from wherry.robot import Odometry
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose
from wherry.space.trajectory import Trajectory

INTEL = Path("intel/intel_910_rawodom.clf.gz")
WEAN_MAP = Path("wean/wean.dat.gz")
WEAN_LOGS = tuple(Path(f"wean/robotdata{number}.log.gz") for number in (1, 2, 3))
FOUND = 0.5  # m, from the reference


@dataclass(frozen=True)
class Halves:
    """A log of which the even scans have made the map, and the odd ones are localized on it.

    Attributes:
        log: All scans.
        odometry: At the scans.
        grid: The map of the even ones.
        odd: [N] numbers of the odd ones.
        reference: [N, 3] m, m, rad, map frame: base_link at the odd scans, by SLAM of the even ones and by odometry
            in between.
    """

    log: LidarLog
    odometry: tuple[Odometry, ...]
    grid: OccupancyGrid
    odd: tuple[int, ...]
    reference: Floats


@dataclass(frozen=True, slots=True)
class Tracking:
    """One seed's run over the odd scans, started where the reference does.

    Attributes:
        median_m: Of the distances to the reference.
        p99_m: Their 99th percentile.
        beyond: Share of the scans farther from the reference than FOUND.
        lost: Share of the scans with the robot believed to be lost.
    """

    median_m: float
    p99_m: float
    beyond: float
    lost: float


@dataclass(frozen=True, slots=True)
class SingleScans:
    """Every odd scan, relocalized by itself on the whole map.

    Attributes:
        scans: How many.
        found: Share whose best hypothesis is within FOUND of the reference.
        ambiguous: Share that was declared ambiguous.
        found_or_ambiguous: Share that was either.
        seconds_median: s a scan, of a core.
        seconds_worst: Likewise.
    """

    scans: int
    found: float
    ambiguous: float
    found_or_ambiguous: float
    seconds_median: float
    seconds_worst: float


def halves(path: Path) -> Halves:
    """Map the even scans of a log, and place the odd ones among them.

    Raises:
        InputError: The log cannot be read, or has scans without odometry.
    """
    log = read_log(path)
    readings = tuple(odometry for odometry in log.scan_odometry if odometry is not None)
    if len(readings) < len(log.scans):
        raise InputError(path, "", "has scans without odometry, which localization needs")
    slam = GraphSlam(log.lidar)
    for scan, odometry in list(zip(log.scans, readings, strict=True))[::2]:
        slam.add(scan, odometry)
    slam.finish()
    driven = Trajectory(
        np.array([reading.time for reading in readings]), np.array([reading.pose.as_array() for reading in readings])
    )
    odd = tuple(range(1, len(log.scans), 2))
    times = np.array([log.scans[number].time for number in odd])
    return Halves(log, readings, slam.grid(), odd, slam.trajectory.at(times, driven))


def track(data: Halves, seed: int) -> Tracking:
    """Localize all odd scans from a known start."""
    localizer = Localizer(data.grid, data.log.lidar, LOG_PARAMETERS, np.random.default_rng(seed))
    localizer.initialize(Pose.from_array(data.reference[0]), START_COVARIANCE)
    errors, lost = [], []
    for number, truth in zip(data.odd, data.reference, strict=True):
        found = localizer.update(data.odometry[number], data.log.scans[number])
        errors.append(found.pose.distance_to(Pose.from_array(truth)))
        lost.append(found.lost_probability > LOST)
    away = np.array(errors)
    return Tracking(
        median_m=float(np.median(away)),
        p99_m=float(np.quantile(away, 0.99)),
        beyond=float(np.mean(away > FOUND)),
        lost=float(np.mean(lost)),
    )


def relocalize(data: Halves, every: int = 1) -> SingleScans:
    """Relocalize from each odd scan, or from every ``every``-th of them; the first once more, for it compiles."""
    relocalizer = Relocalizer(data.grid, data.log.lidar, LOG_PARAMETERS)
    relocalizer.search(data.log.scans[data.odd[0]])
    found, ambiguous, seconds = [], [], []
    for number, truth in list(zip(data.odd, data.reference, strict=True))[::every]:
        before = time.thread_time()
        result = relocalizer.search(data.log.scans[number])
        seconds.append(time.thread_time() - before)
        best = result.hypotheses[0].pose if result.hypotheses else None
        found.append(best is not None and best.distance_to(Pose.from_array(truth)) < FOUND)
        ambiguous.append(result.ambiguous)
    return SingleScans(
        scans=len(seconds),
        found=float(np.mean(found)),
        ambiguous=float(np.mean(ambiguous)),
        found_or_ambiguous=float(np.mean(np.logical_or(found, ambiguous))),
        seconds_median=float(np.median(seconds)),
        seconds_worst=max(seconds),
    )


def final_poses(log: Path, map_file: Path, seeds: range) -> Iterator[Floats]:
    """[3] m, m, rad, map frame: where each seed ends that began without knowing where the robot is.

    Raises:
        InputError: Log or map cannot be read.
    """
    for seed in seeds:
        run = prepare(Settings(log, map_file, everywhere=True, seed=seed))
        for _ in run.steps():
            pass
        yield np.array(run.result().final_pose)


def most_together(finals: Floats) -> int:
    """How many of the poses [N, 3] are within FOUND of one of them, at most: N if all have come to one place."""
    away = np.hypot(*(finals[:, None, :2] - finals[None, :, :2]).transpose(2, 0, 1))
    return int((away < FOUND).sum(axis=1).max())
