"""Localization of real robots: half of the Intel log on the map of the other half, Wean Hall from anywhere."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wherry.errors import InputError
from wherry.experiments.localization.kidnapping import is_found
from wherry.localization.localizer import Localizer
from wherry.localization.relocalization import Relocalizer
from wherry.logs.carmen import LidarLog, read_log
from wherry.mapping.graph_slam import GraphSlam
from wherry.pipelines.logs.localization import (
    INITIAL_POSE_COVARIANCE,
    LOG_PARAMETERS,
    LOST,
    Settings,
    advancing_times,
    prepare,
)
from wherry.robot import Odometry, Scan, Velocity
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose
from wherry.space.trajectory import Trajectory

INTEL = Path("intel/intel_910_rawodom.clf.gz")
WEAN_MAP = Path("wean/wean.dat.gz")
WEAN_LOGS = tuple(Path(f"wean/robotdata{number}.log.gz") for number in (1, 2, 3))
FOUND = 0.5  # m, from the reference
PAUSE = 3.0  # s in which a robot is carried off
LEG = 40  # scans of a log that are played after that
ELSEWHERE = 3.0  # m, that it is carried at least


@dataclass(frozen=True)
class Recording:
    """Scans with odometry, and where the robot truly was.

    Attributes:
        scans: [N] in order.
        odometry: [N] base_link in the odom frame.
        poses: [N, 3] m, m, rad: base_link in the map frame.
    """

    scans: tuple[Scan, ...]
    odometry: tuple[Pose, ...]
    poses: Floats


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

    @property
    def recording(self) -> Recording:
        """The odd scans."""
        scans = tuple(self.log.scans[number] for number in self.odd)
        return Recording(scans, tuple(self.odometry[number].pose for number in self.odd), self.reference)


@dataclass(frozen=True, slots=True)
class Tracking:
    """One seed's run over the odd scans, started where the reference does.

    Attributes:
        median_m: Of the distances to the reference.
        p99_m: Their 99th percentile.
        beyond: Share of the scans farther from the reference than FOUND.
        lost: Share of the scans with the robot believed to be lost.
        stated: [M] probability of being lost at these scans, and at those after the robot was then carried off.
        truly_lost: [M] whether it was.
    """

    median_m: float
    p99_m: float
    beyond: float
    lost: float
    stated: Floats
    truly_lost: NDArray[np.bool_]


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


def with_kidnappings(recording: Recording, legs: Sequence[range]) -> Iterator[tuple[Odometry, Scan, Pose]]:
    """Play a recording in pieces, as if the robot had been picked up after each and put down where the next begins.

    Args:
        recording: To be played.
        legs: The pieces; numbers of scans.

    Yields:
        Odometry and scan, whose clock goes on as if nothing had happened, and where the robot truly is.
    """
    times = advancing_times(np.array([scan.time for scan in recording.scans]))
    at, odometry = 0.0, Pose()
    for leg in legs:
        for number in leg:
            if number == leg.start:
                at += PAUSE
            else:
                at += float(times[number] - times[number - 1])
                odometry @= recording.odometry[number].relative_to(recording.odometry[number - 1])
            truth = Pose.from_array(recording.poses[number])
            yield Odometry(at, odometry, Velocity()), replace(recording.scans[number], time=at), truth


def track(data: Halves, seed: int) -> Tracking:
    """Localize all odd scans from a known start; then carry the robot off and go on for a while."""
    recording = data.recording
    length = len(recording.scans)
    rng, way_rng = np.random.default_rng(seed), np.random.default_rng((seed, 1))
    localizer = Localizer(data.grid, data.log.lidar, LOG_PARAMETERS, rng)
    localizer.initialize(Pose.from_array(data.reference[0]), INITIAL_POSE_COVARIANCE)
    errors, stated, truly_lost = [], [], []
    elsewhere = somewhere_else(recording, length - 1, way_rng)
    for odometry, scan, truth in with_kidnappings(recording, [range(length), elsewhere]):
        found = localizer.update(odometry, scan)
        errors.append(found.pose.distance_to(truth))
        stated.append(found.lost_probability)
        truly_lost.append(not is_found(found.pose, truth))
    away, before = np.array(errors[:length]), np.array(stated[:length])
    return Tracking(
        median_m=float(np.median(away)),
        p99_m=float(np.quantile(away, 0.99)),
        beyond=float(np.mean(away > FOUND)),
        lost=float(np.mean(before > LOST)),
        stated=np.array(stated),
        truly_lost=np.array(truly_lost),
    )


def somewhere_else(recording: Recording, number: int, rng: np.random.Generator) -> range:
    """A piece of a recording that begins far away from where its scan of this number was taken."""
    away = np.hypot(*(recording.poses[:, :2] - recording.poses[number, :2]).T)
    starts = np.flatnonzero(away[: len(away) - LEG] > ELSEWHERE)
    start = int(rng.choice(starts))
    return range(start, start + LEG)


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
