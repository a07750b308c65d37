"""EKF localization: one Gaussian, predicted by odometry and corrected by matching each scan to the map.

Probabilistic Robotics, table 7.2, with a scan match (`refinement.match_scan`) instead of landmarks: the match measures
the pose itself, so that the measurement Jacobian H is the identity. The paper's section 5.A calls it the Kalman filter.
"""

from __future__ import annotations

import math

import numpy as np

from wherry.localization.parameters import AmclParameters
from wherry.localization.refinement import MAX_MATCHED_BEAMS, match_scan
from wherry.localization.sensor import valid_beams
from wherry.robot import Odometry, Scan
from wherry.space.distance_field import DistanceField
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose


class EkfLocalization:
    """A Gaussian over poses on a known map.

    Args:
        grid: The map.
        lidar: The lidar's pose, base_link frame.
        parameters: alpha1 to alpha4, the range limits and sigma_hit are used.
    """

    def __init__(self, grid: OccupancyGrid, lidar: Pose, parameters: AmclParameters) -> None:
        self._field = DistanceField.of(grid, parameters.laser_likelihood_max_dist)
        self._lidar = lidar
        self._parameters = parameters
        self._odometry: Pose | None = None
        self.initialize(parameters.initial_pose, np.diag(parameters.initial_covariance))

    @property
    def memory(self) -> int:
        """Size of the mean and the covariance, bytes."""
        return self._covariance.nbytes + self._pose.as_array().nbytes

    def initialize(self, pose: Pose, covariance: Floats) -> None:
        """Set the Gaussian.

        Args:
            pose: Mean pose of base_link, map frame.
            covariance: [3, 3] m, m, rad.
        """
        self._pose = pose
        self._covariance = covariance.copy()

    def update(self, odometry: Odometry, scan: Scan) -> Pose:
        """Process one scan and the odometry of the same instant.

        Returns:
            The estimated pose of base_link at that instant, map frame.
        """
        motion = Pose() if self._odometry is None else odometry.pose.relative_to(self._odometry)
        self._odometry = odometry.pose
        self._predict(motion)
        ends = valid_beams(scan, self._lidar, self._parameters).evenly_spaced(MAX_MATCHED_BEAMS).ends
        if len(ends):
            match = match_scan(self._field, ends, self._pose, self._covariance, self._parameters.sigma_hit)
            if match.is_accepted:
                self._pose, self._covariance = match.pose, match.covariance
        return self._pose

    def _predict(self, motion: Pose) -> None:
        """Move the mean, and the covariance by the motion's Jacobians G and V and noise M (table 7.2, lines 3 to 7)."""
        p = self._parameters
        translation = math.hypot(motion.x, motion.y)
        turn = abs(motion.theta)
        bearing = self._pose.theta + math.atan2(motion.y, motion.x)
        moved = self._pose @ motion
        jacobian = np.eye(3)
        jacobian[0, 2] = -(moved.y - self._pose.y)
        jacobian[1, 2] = moved.x - self._pose.x
        along = p.alpha3 * translation**2 + p.alpha4 * turn**2
        turned = p.alpha1 * turn**2 + p.alpha2 * translation**2
        cos, sin = math.cos(bearing), math.sin(bearing)
        spread = np.array([[cos, 0.0], [sin, 0.0], [0.0, 1.0]])
        noise = spread @ np.diag([along, turned]) @ spread.T
        self._covariance = jacobian @ self._covariance @ jacobian.T + noise
        self._pose = moved
