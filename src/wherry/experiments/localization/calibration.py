"""Where the coefficients of `localization.lost.Calibration` come from: robots that were carried off, over and over.

Fitted to two simulated worlds and to three buildings, whose maps are made of other scans than those that are
localized. What judges the outcome is kept apart: the world `rooms` and the Intel lab, of which nothing is used here.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wherry.experiments.localization import kidnapping
from wherry.experiments.localization.recorded import LEG, Recording, with_kidnappings
from wherry.experiments.mapping.drifting_odometry import BUILDINGS, drifted
from wherry.localization.localizer import Localization, Localizer
from wherry.localization.lost import SCANS_UNTIL_LOST, Calibration, LostDetector, fit_calibration
from wherry.logs.carmen import LidarLog, read_log
from wherry.pipelines.logs.localization import INITIAL_POSE_COVARIANCE, LOG_PARAMETERS
from wherry.space.mapper import GridMapper
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose

WORLDS = (
    kidnapping.Settings("offices", boxes=8, seed=1, seconds=600.0, kidnappings=40, patience=15.0),
    kidnapping.Settings("small", boxes=2, seed=2, seconds=300.0, kidnappings=40, patience=12.0),
)
KIDNAPPINGS = 60  # in each building
RESOLUTION = 0.05  # m, of the buildings' maps
AT_ONE_PLACE = 0.9  # share of the belief; what is believed less is lost for another reason, and no example


@dataclass(frozen=True)
class Watched:
    """What the detector had to go by at every scan of a run, and the truth.

    Attributes:
        features: [N, 2] see `LostDetector.features`.
        belief: [N] share of the belief that was at the estimate.
        lost: [N] whether the robot was lost.
        kidnappings: How often it was carried off.
    """

    features: Floats
    belief: Floats
    lost: NDArray[np.bool_]
    kidnappings: int


def calibrate(runs: Iterable[Watched]) -> Calibration:
    """Fit the coefficients to runs that weigh the same, as if a robot got lost once in `SCANS_UNTIL_LOST` scans."""
    features, lost, weights = [], [], []
    for run in runs:
        wanted = np.count_nonzero(~run.lost) / SCANS_UNTIL_LOST / run.kidnappings
        weight = np.where(run.lost, wanted, 1.0)
        chosen = run.belief > AT_ONE_PLACE
        features.append(run.features[chosen])
        lost.append(run.lost[chosen])
        weights.append((weight / weight.sum())[chosen])
    return fit_calibration(np.concatenate(features), np.concatenate(lost), np.concatenate(weights))


def runs(data: Path) -> Iterator[Watched]:
    """All that the coefficients are fitted to.

    Args:
        data: The folder of recorded logs.

    Raises:
        InputError: A log cannot be read.
    """
    yield from (in_simulation(settings) for settings in WORLDS)
    yield from (in_building(data / f"radish/{name}-corrected.log.gz", seed=1) for name in BUILDINGS)


def in_simulation(settings: kidnapping.Settings) -> Watched:
    """Watch a simulated robot."""
    sights = kidnapping.run(settings)
    return _watch(((sight.found, not sight.is_found) for sight in sights), settings.kidnappings)


def in_building(log_file: Path, seed: int) -> Watched:
    """Watch the odd scans of a log on the map of the even ones, with odometry that drifts: all in order, then pieces.

    Args:
        log_file: A log whose poses were corrected.
        seed: Of the drift, the filter and the pieces.

    Raises:
        InputError: The log cannot be read.
    """
    rng = np.random.default_rng(seed)
    log = read_log(log_file, lenient=True)
    poses = np.array([odometry.pose.as_array() for odometry in log.scan_odometry if odometry is not None])
    odometry = [Pose.from_array(pose) for pose in drifted(poses, rng)]
    recording = Recording(log.scans[1::2], tuple(odometry[1::2]), poses[1::2])
    length = len(recording.scans)
    starts = rng.integers(length - LEG, size=KIDNAPPINGS).tolist()
    localizer = Localizer(_map_of_even(log, poses), log.lidar, LOG_PARAMETERS, rng)
    localizer.initialize(Pose.from_array(recording.poses[0]), INITIAL_POSE_COVARIANCE)

    def steps() -> Iterator[tuple[Localization, bool]]:
        legs = [range(length), *(range(start, start + LEG) for start in starts)]
        for reading, scan, truth in with_kidnappings(recording, legs):
            found = localizer.update(reading, scan)
            yield found, not kidnapping.is_found(found.pose, truth)

    return _watch(steps(), KIDNAPPINGS)


def _map_of_even(log: LidarLog, poses: Floats) -> OccupancyGrid:
    mapper = GridMapper(RESOLUTION)
    for scan, pose in zip(log.scans[::2], poses[::2], strict=True):
        lidar = Pose.from_array(pose) @ log.lidar
        ends = lidar.transform(scan.points())
        mapper.add(lidar.as_array()[:2], ends, np.ones(len(ends), np.bool_))
    return mapper.grid()


def _watch(steps: Iterable[tuple[Localization, bool]], kidnappings: int) -> Watched:
    """Have a detector look at every scan as the localizer's own did."""
    detector = LostDetector()
    features, belief, lost = [], [], []
    for found, truly_lost in steps:
        if found.estimate.problem:
            continue
        detector.observe(found.estimate.time, found.agreement)
        features.append(detector.features)
        belief.append(found.estimate.weight)
        lost.append(truly_lost)
        if found.hypotheses:
            detector.reset()
    return Watched(np.array(features), np.array(belief), np.array(lost), kidnappings)
