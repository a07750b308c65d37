"""Pose estimators: SLAM during mapping, localization on a finished map, and global localization."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from wherry.errors import InputError
from wherry.localization.agreement import ScanAgreement
from wherry.localization.fit import MapFit
from wherry.localization.localizer import Localizer
from wherry.localization.parameters import LOST_PROBABILITY_THRESHOLD
from wherry.mapping.graph_slam import GraphSlam
from wherry.realization.pose_tracker import PoseEstimator, SinglePoseEstimator
from wherry.robot import Odometry, Scan
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose

LOCALIZED_THRESHOLD = 0.1  # lost probability below which an unreliable pose becomes reliable again
FIT_MIN_SCANS = 200  # scans from which their fit decides whether a given map is the right one
FIT_DECAY = 1.0 - 1.0 / 600  # factor of the earlier scans' weights in the fit, of which a minute's count
MAX_TIMES_LOST, LOST_PERIOD = 5, 600.0  # times that the robot gets lost in s after which a given map is given up
LOCALIZED_MIN_SCANS = 10  # consecutive scans below LOCALIZED_THRESHOLD that end global localization


class SlamPoseEstimator(SinglePoseEstimator):
    """Estimates the pose on the map that SLAM builds; never lost, since the map is built relative to the pose."""

    def __init__(self, slam: GraphSlam) -> None:
        self._slam = slam
        self._resumed_at: Pose | None = None

    def resume(self, pose: Pose) -> None:
        """Continue mapping at the next scan from a pose that another estimator tracked, base_link in the map frame."""
        self._resumed_at = pose

    def update(self, odometry: Odometry, scan: Scan) -> Pose:
        """As `PoseEstimator.update`."""
        if self._resumed_at is None:
            return self._slam.add(scan, odometry)
        pose, self._resumed_at = self._resumed_at, None
        return self._slam.resume(scan, odometry, pose)


class Mapper(Protocol):
    """Builds the map during exploration and estimates the robot's pose on it."""

    @property
    def pose_estimator(self) -> PoseEstimator:
        """Estimates the pose on the map."""
        ...

    @property
    def start(self) -> Pose:
        """base_link in the map frame when exploration begins."""
        ...

    def grid(self) -> OccupancyGrid:
        """The map so far."""
        ...

    def resume(self, pose: Pose) -> None:
        """Continue mapping at the next scan from a pose that another estimator tracked, base_link in the map frame."""
        ...


class SlamMapper:
    """A `Mapper` that uses `GraphSlam`; the map frame is the base_link frame at the start.

    Args:
        lidar: The lidar in the base_link frame.
    """

    def __init__(self, lidar: Pose) -> None:
        self._slam = GraphSlam(lidar)
        self._pose_estimator = SlamPoseEstimator(self._slam)
        self.start = Pose()

    @property
    def pose_estimator(self) -> PoseEstimator:
        """As `Mapper.pose_estimator`."""
        return self._pose_estimator

    def grid(self) -> OccupancyGrid:
        """As `Mapper.grid`."""
        return self._slam.grid()

    def resume(self, pose: Pose) -> None:
        """As `Mapper.resume`."""
        self._pose_estimator.resume(pose)


def check_fit(fit: MapFit) -> None:
    """Give up on a map that the scans do not fit.

    Raises:
        InputError: Enough scans were compared with the map, and they do not fit it.
    """
    if fit.scans >= FIT_MIN_SCANS and not fit.is_fitting:
        raise InputError("map", "", f"does not fit what the lidar sees: {fit.mismatch}")


class MapPoseEstimator:
    """Estimates the pose on a finished map, with hysteresis between lost and localized.

    In a building whose wings look the same the pose stays reliable in its own wing; which wing it is does not matter
    for driving.

    Args:
        localizer: The localizer, already initialized.
        is_map_given: Whether somebody else made the map, so that it may be of another building.
    """

    def __init__(self, localizer: Localizer, *, is_map_given: bool = False) -> None:
        self._localizer = localizer
        self._is_map_given = is_map_given
        self._is_lost = False
        self._fit = MapFit()
        self._times_lost: list[float] = []

    def update(self, odometry: Odometry, scan: Scan) -> Pose:
        """As `PoseEstimator.update`.

        Raises:
            InputError: The map was given, and the scans do not fit it.
        """
        estimate = self._localizer.update(odometry, scan)
        threshold = LOCALIZED_THRESHOLD if self._is_lost else LOST_PROBABILITY_THRESHOLD
        was_lost, self._is_lost = self._is_lost, estimate.tracking_lost_probability > threshold
        if self._is_map_given:
            self._check_map(scan.time, estimate.agreement, got_lost=self._is_lost and not was_lost)
        return estimate.pose

    def _check_map(self, time: float, agreement: ScanAgreement, *, got_lost: bool) -> None:
        """Give up if the last minute's scans do not fit the map, or if the robot gets lost on it again and again."""
        self._fit = self._fit.with_scan(agreement, decay=FIT_DECAY)
        check_fit(self._fit)
        if got_lost:
            self._times_lost = [*(past for past in self._times_lost if past > time - LOST_PERIOD), time]
        if len(self._times_lost) >= MAX_TIMES_LOST:
            reason = f"does not fit what the lidar sees: the robot got lost on it {MAX_TIMES_LOST} times"
            raise InputError("map", "", f"{reason} in {LOST_PERIOD / 60.0:g} minutes")

    @property
    def particles(self) -> NDArray[np.float64]:
        """[N, 3] particles x, y, θ, m, m, rad, map frame."""
        return self._localizer.particles

    @property
    def is_lost(self) -> bool:
        """Whether the pose is unreliable: from `LOST_PROBABILITY_THRESHOLD` until below `LOCALIZED_THRESHOLD`."""
        return self._is_lost


class GlobalPoseEstimator(SinglePoseEstimator):
    """Localizes the robot globally on a map while it drives by odometry alone.

    As a `PoseEstimator` it returns poses in the odom frame; the estimate on the map is an attribute.

    Attributes:
        map_pose: Estimate of base_link in the map frame at the last scan.
    """

    def __init__(self, localizer: Localizer) -> None:
        self._localizer = localizer
        self._localized_scans = 0
        self._tracked_scans = 0
        self.map_pose = Pose()

    @property
    def is_localized(self) -> bool:
        """Whether the lost probability was below `LOCALIZED_THRESHOLD` in the last `LOCALIZED_MIN_SCANS` scans."""
        return self._localized_scans >= LOCALIZED_MIN_SCANS

    @property
    def is_localized_up_to_symmetry(self) -> bool:
        """As `is_localized`, but other poses that agree as well with all scans are disregarded."""
        return self._tracked_scans >= LOCALIZED_MIN_SCANS

    @property
    def fit(self) -> MapFit:
        """How well all scans fit the map."""
        return self._localizer.fit

    def update(self, odometry: Odometry, scan: Scan) -> Pose:
        """Return base_link in the odom frame, and update `map_pose`."""
        estimate = self._localizer.update(odometry, scan)
        self._localized_scans = self._localized_scans + 1 if estimate.lost_probability < LOCALIZED_THRESHOLD else 0
        is_tracked = estimate.tracking_lost_probability < LOCALIZED_THRESHOLD
        self._tracked_scans = self._tracked_scans + 1 if is_tracked else 0
        self.map_pose = estimate.pose
        return odometry.pose
