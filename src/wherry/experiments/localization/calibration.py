"""Fitting the coefficients of `localization.lost` to kidnapped robots.

The coefficients are fitted to two simulated worlds and three recorded buildings. Each building is mapped from its even
scans, and its odd scans are localized. The world `rooms` and the Intel lab are held out for the evaluation.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wherry.experiments.localization import kidnapping
from wherry.experiments.localization.recorded import SEGMENT_SCANS, GroundTruthLog, play_segments
from wherry.experiments.mapping.drifting_odometry import BUILDINGS, building_log, drifting_odometry
from wherry.localization.agreement import ScanAgreement
from wherry.localization.localizer import Localization, Localizer
from wherry.localization.lost import EvidenceModel, LostCalibration, LostDetector
from wherry.localization.parameters import KNOWN_START_COVARIANCE, LOG_PARAMETERS
from wherry.logs.lidar_log import LidarLog
from wherry.logs.options import ReadingOptions
from wherry.logs.reading import read_log
from wherry.space.mapper import GridMapper
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose

WORLDS = (
    kidnapping.KidnappingSettings(
        "offices", boxes=8, seed=1, tracking_seconds=600.0, kidnappings=40, seconds_per_kidnapping=15.0
    ),
    kidnapping.KidnappingSettings(
        "small", boxes=2, seed=2, tracking_seconds=300.0, kidnappings=40, seconds_per_kidnapping=12.0
    ),
)
KIDNAPPINGS = 60  # kidnappings in each building
RESOLUTION = 0.05  # m, side of the cells of the buildings' maps
MIN_WEIGHT = 0.9  # posterior weight of the estimate above which a scan is used, as others are lost by ambiguity
SCANS_UNTIL_LOST = 2000  # mean number of scans until a robot gets lost, the base rate of the calibration
RIDGE = 1e-3  # regularization of the regressions, which keeps them finite on separable data
NEWTON_ITERATIONS = 30  # iterations of the logistic regression


@dataclass(frozen=True)
class LabelledScans:
    """Features of all scans of a run, with the ground truth.

    Attributes:
        features: [N, 2] mean evidence and z-score of every scan, see `lost.LostFeatures`.
        weights: [N] posterior weight of the estimate, 0 to 1.
        is_lost: [N] whether the robot was lost.
        kidnappings: Number of kidnappings in the run.
    """

    features: Floats
    weights: Floats
    is_lost: NDArray[np.bool_]
    kidnappings: int


def calibrate(runs: Iterable[LabelledScans]) -> LostCalibration:
    """Fit the calibration to equally weighted runs, at a base rate of one loss in `SCANS_UNTIL_LOST` scans."""
    features, is_lost, weights = [], [], []
    for run in runs:
        lost_weight = np.count_nonzero(~run.is_lost) / SCANS_UNTIL_LOST / run.kidnappings
        weight = np.where(run.is_lost, lost_weight, 1.0)
        chosen = run.weights > MIN_WEIGHT
        features.append(run.features[chosen])
        is_lost.append(run.is_lost[chosen])
        weights.append((weight / weight.sum())[chosen])
    return fit_calibration(np.concatenate(features), np.concatenate(is_lost), np.concatenate(weights))


def fit_evidence(agreements: list[ScanAgreement], is_lost: NDArray[np.bool_]) -> EvidenceModel:
    """Fit the coefficients of a scan's evidence, with equal total weight of lost and localized robots.

    Args:
        agreements: [N] agreements of scans with the map at correct and wrong poses.
        is_lost: [N] whether the pose was wrong; both cases must occur.
    """
    fractions = np.array([[scan.inlier_fraction, scan.blocked_fraction, scan.passed_fraction] for scan in agreements])
    balance = np.where(is_lost, 0.5 / is_lost.mean(), 0.5 / (1.0 - is_lost.mean()))
    return EvidenceModel(*logistic_regression(fractions, is_lost, balance).tolist())


def fit_calibration(features: Floats, is_lost: NDArray[np.bool_], weights: Floats) -> LostCalibration:
    """Fit the coefficients of the probability of being lost.

    Args:
        features: [N, 2] mean evidence and z-score, see `lost.LostFeatures`.
        is_lost: [N] whether the robot was lost; both cases must occur.
        weights: [N] relative weights of the scans.
    """
    columns = np.column_stack([np.ones(len(is_lost)), features[:, 0], np.sqrt(features[:, 1])])
    return LostCalibration(*logistic_regression(columns, is_lost, weights / weights.sum() * len(weights)).tolist())


def logistic_regression(
    features: Floats, labels: NDArray[np.bool_], weights: Floats, *, ridge: float = RIDGE
) -> Floats:
    """[F] coefficients of a weighted, ridge-regularized logistic regression, by Newton's method."""
    coefficients = np.zeros(features.shape[1])
    for _ in range(NEWTON_ITERATIONS):
        predicted = 1.0 / (1.0 + np.exp(-features @ coefficients))
        curvature = weights * predicted * (1.0 - predicted)
        hessian = (features * curvature[:, None]).T @ features + ridge * np.eye(len(coefficients))
        gradient = features.T @ (weights * (labels - predicted)) - ridge * coefficients
        coefficients += np.linalg.solve(hessian, gradient)
    return coefficients


def calibration_runs(data: Path) -> Iterator[LabelledScans]:
    """Run the robots that the calibration is fitted to.

    Args:
        data: Folder of recorded logs.

    Raises:
        InputError: A log cannot be read.
    """
    yield from (label_simulation(settings) for settings in WORLDS)
    yield from (label_building(data / building_log(name), seed=1) for name in BUILDINGS)


def label_simulation(settings: kidnapping.KidnappingSettings) -> LabelledScans:
    """Features and ground truth of a simulated robot."""
    scans = kidnapping.run(settings)
    return _label(((scan.localization, not scan.is_localized) for scan in scans), settings.kidnappings)


def label_building(log_file: Path, seed: int) -> LabelledScans:
    """Features and ground truth of the odd scans of a log on the map of the even ones, with drifting odometry.

    The robot drives the whole log and is then kidnapped to the starts of random segments of it.

    Args:
        log_file: Path of a log whose poses were corrected.
        seed: Seed of the drift, the filter and the segments.

    Raises:
        InputError: The log cannot be read.
    """
    rng = np.random.default_rng(seed)
    log = read_log(log_file, ReadingOptions(lenient=True))
    poses = np.array([odometry.pose.as_array() for odometry in log.scan_odometry if odometry is not None])
    odometry = [Pose.from_array(pose) for pose in drifting_odometry(poses, rng)]
    odd = GroundTruthLog(log.scans[1::2], tuple(odometry[1::2]), poses[1::2])
    length = len(odd.scans)
    starts = rng.integers(length - SEGMENT_SCANS, size=KIDNAPPINGS).tolist()
    localizer = Localizer(map_of_even_scans(log, poses), log.lidar, LOG_PARAMETERS, rng)
    localizer.initialize(Pose.from_array(odd.poses[0]), KNOWN_START_COVARIANCE)

    def steps() -> Iterator[tuple[Localization, bool]]:
        segments = [range(length), *(range(start, start + SEGMENT_SCANS) for start in starts)]
        for reading, scan, truth in play_segments(odd, segments):
            localization = localizer.update(reading, scan)
            yield localization, not kidnapping.is_localized(localization.pose, truth)

    return _label(steps(), KIDNAPPINGS)


def map_of_even_scans(log: LidarLog, poses: Floats) -> OccupancyGrid:
    """The map of the even scans; the poses [N, 3] m, m, rad, map frame, are of all scans."""
    mapper = GridMapper(RESOLUTION)
    for scan, pose in zip(log.scans[::2], poses[::2], strict=True):
        lidar = Pose.from_array(pose) @ log.lidar
        ends = lidar.transform(scan.points())
        mapper.add(lidar.as_array()[:2], ends, np.ones(len(ends), np.bool_))
    return mapper.grid()


def _label(steps: Iterable[tuple[Localization, bool]], kidnappings: int) -> LabelledScans:
    """Repeat the localizer's detection of being lost on its agreements, and collect the features."""
    detector = LostDetector()
    features, weights, is_lost = [], [], []
    for localization, is_truly_lost in steps:
        if localization.estimate.problem:
            continue
        detector.update(localization.estimate.time, localization.agreement)
        features.append((detector.features.mean_evidence, detector.features.z_score))
        weights.append(localization.estimate.weight)
        is_lost.append(is_truly_lost)
        if localization.hypotheses:
            detector.reset()
    return LabelledScans(np.array(features), np.array(weights), np.array(is_lost), kidnappings)
