"""What keeps a robot's pose: making the map, being on a finished one, or looking for itself on it."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from wherry.localization.localizer import Localizer
from wherry.mapping.graph_slam import GraphSlam
from wherry.realization.tracking import Corrector, OnePose
from wherry.robot import Odometry, Scan
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose

UNSURE = 0.5  # probability of being lost from which on a robot stops and looks around
SURE, SURE_SCANS = 0.1, 10  # probability of being lost that a robot accepts, in so many scans in a row


class SlamCorrector(OnePose):
    """Corrects the pose by making the map; where the robot is, there the map is, so it is never lost."""

    def __init__(self, slam: GraphSlam) -> None:
        self._slam = slam
        self._resumed_at: Pose | None = None

    def resume(self, pose: Pose) -> None:
        """Go on mapping where the robot stands after others have kept its pose: base_link in the map frame."""
        self._resumed_at = pose

    def correct(self, odometry: Odometry, scan: Scan) -> Pose:
        """As `Corrector.correct`."""
        if self._resumed_at is None:
            return self._slam.add(scan, odometry)
        pose, self._resumed_at = self._resumed_at, None
        return self._slam.resume(scan, odometry, pose)


class Mapper(Protocol):
    """What gives a map that grows while the robot explores, and the robot's pose on it."""

    @property
    def corrector(self) -> Corrector:
        """Corrects the pose on the map."""
        ...

    @property
    def start(self) -> Pose:
        """base_link in the map frame where exploring begins."""
        ...

    def grid(self) -> OccupancyGrid:
        """The map so far."""
        ...

    def resume(self, pose: Pose) -> None:
        """Go on mapping where the robot stands after others have kept its pose: base_link in the map frame."""
        ...


class OwnMapper:
    """Our own SLAM; the map frame is where the robot starts.

    Args:
        lidar: The lidar's pose, base_link frame.
    """

    def __init__(self, lidar: Pose) -> None:
        self._slam = GraphSlam(lidar)
        self._corrector = SlamCorrector(self._slam)
        self.start = Pose()

    @property
    def corrector(self) -> Corrector:
        """As `Mapper.corrector`."""
        return self._corrector

    def grid(self) -> OccupancyGrid:
        """As `Mapper.grid`."""
        return self._slam.grid()

    def resume(self, pose: Pose) -> None:
        """As `Mapper.resume`."""
        self._corrector.resume(pose)


class MapCorrector:
    """Corrects the pose on a finished map."""

    def __init__(self, localizer: Localizer) -> None:
        self._localizer = localizer
        self._lost = False

    def correct(self, odometry: Odometry, scan: Scan) -> Pose:
        """As `Corrector.correct`."""
        found = self._localizer.update(odometry, scan)
        self._lost = found.lost_probability > (SURE if self._lost else UNSURE)
        return found.pose

    @property
    def particles(self) -> NDArray[np.float64]:
        """[N, 3] x m, y m, θ rad, map frame."""
        return self._localizer.particles

    @property
    def lost(self) -> bool:
        """From when it is more likely lost than not, until it is sure again."""
        return self._lost


class Searcher(OnePose):
    """Looks for the robot's place on a map while the robot drives by odometry alone, in the odom frame.

    There it is where its wheels say, and the belief on the map has no place.
    """

    def __init__(self, localizer: Localizer) -> None:
        self._localizer = localizer
        self._sure_scans = 0
        self.found = Pose()

    @property
    def is_sure(self) -> bool:
        """Whether the place has been beyond doubt for some scans in a row."""
        return self._sure_scans >= SURE_SCANS

    def correct(self, odometry: Odometry, scan: Scan) -> Pose:
        """As `Corrector.correct`, but the map frame here is the odom frame."""
        located = self._localizer.update(odometry, scan)
        self._sure_scans = self._sure_scans + 1 if located.lost_probability < SURE else 0
        self.found = located.pose
        return odometry.pose
