"""The front end's state: pose and covariance on the tracked submap, and the velocity that predicts the next pose."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from wherry.mapping.covariances import invert, transform_covariance
from wherry.mapping.motion_noise import ODOMETRY_NOISE, MotionNoise, constant_velocity_noise
from wherry.mapping.odometry_check import (
    BIAS_GAIN,
    CONTRADICTION_COST,
    FULL_CREDIT,
    MAX_DISAGREEMENT,
    TELLING_ANGLE,
    TELLING_DISTANCE,
    TRUSTED_CREDIT,
    is_plausible,
)
from wherry.mapping.placement import Prediction
from wherry.mapping.submaps import NO_COVARIANCE
from wherry.robot import Odometry
from wherry.space.pose import IDENTITY, Floats, Pose

MAX_EXTRAPOLATED_DISTANCE = 2.0  # m, longest motion that constant velocity predicts over a gap in the log
MAX_EXTRAPOLATED_ANGLE = math.radians(60.0)  # rad, largest turn that constant velocity predicts over a gap in the log
# Covariance (m, m, rad) that every keyframe adds, since surfaces are rough and the robot moves during a scan.
KEYFRAME_COVARIANCE = np.diag([0.003**2, 0.003**2, math.radians(0.1) ** 2])


@dataclass(frozen=True)
class TrackingState:
    """State of the front end after a scan, on the submap that scans are matched to.

    Attributes:
        submap: Index of the tracked submap.
        time: Time of the last scan that the pose is of, s.
        pose: base_link at the last scan, in the submap's frame.
        odometry: Odometry at the last scan; None without odometry.
        velocity: Velocity up to the last scan in the base_link frame, [3] m/s, m/s, rad/s.
        keyframe: Index of the last keyframe.
        keyframe_pose: base_link at the last keyframe, in the submap's frame.
        keyframe_odometry: Odometry at the last keyframe; None without odometry, or if it was contradicted since then.
        covariance: Covariance of ``keyframe_pose`` in the base_link frame, [3, 3] m, m, rad.
        next_covariance: Covariance of the last keyframe's pose in the next submap, in the base_link frame, [3, 3]
            m, m, rad.
        odometry_credit: How far odometry is trusted, 0 to `FULL_CREDIT`, see `wherry.mapping.odometry_check`.
        odometry_bias: Moving average of the normalized errors of odometry between keyframes, [3] standard deviations.
        scan_time: Time of the last scan, also of one at which the robot stood still, s.
    """

    submap: int
    time: float
    pose: Pose
    odometry: Odometry | None
    velocity: Floats
    keyframe: int
    keyframe_pose: Pose
    keyframe_odometry: Odometry | None
    covariance: Floats
    next_covariance: Floats
    odometry_credit: int
    odometry_bias: Floats
    scan_time: float

    @classmethod
    def begin(cls, time: float, odometry: Odometry | None) -> TrackingState:
        """The state at the first scan, which is the first keyframe and the origin of the first submap."""
        return cls(
            submap=0,
            time=time,
            pose=IDENTITY,
            odometry=odometry,
            velocity=np.zeros(3),
            keyframe=0,
            keyframe_pose=IDENTITY,
            keyframe_odometry=odometry,
            covariance=NO_COVARIANCE,
            next_covariance=NO_COVARIANCE,
            odometry_credit=FULL_CREDIT,
            odometry_bias=np.zeros(3),
            scan_time=time,
        )

    @property
    def is_odometry_trusted(self) -> bool:
        """Whether odometry predicts motions and constrains keyframes."""
        return self.odometry_credit >= TRUSTED_CREDIT

    def odometry_motion(self, odometry: Odometry | None) -> Pose | None:
        """Motion of base_link since the last scan by odometry; None if either scan has no odometry."""
        if odometry is None or self.odometry is None:
            return None
        return odometry.pose.relative_to(self.odometry.pose)

    def predictions(self, time: float, odometry: Odometry | None) -> tuple[Prediction, ...]:
        """Predicted motions of base_link since the last scan, the most trusted first.

        Odometry that is not trusted, or faster than any robot, comes after constant velocity.
        """
        by_velocity = Prediction(self._extrapolated(time), constant_velocity_noise(time - self.time))
        motion = self.odometry_motion(odometry)
        if motion is None:
            return (by_velocity,)
        by_odometry = Prediction(motion, ODOMETRY_NOISE, is_plausible(motion, time - self.scan_time))
        if self.is_odometry_trusted and by_odometry.is_plausible:
            return (by_odometry, by_velocity)
        return (by_velocity, by_odometry)

    def _extrapolated(self, time: float) -> Pose:
        """The motion at constant velocity, which is bounded over a gap in the log."""
        motion = self.velocity * (time - self.time)
        excess = max(
            math.hypot(motion[0], motion[1]) / MAX_EXTRAPOLATED_DISTANCE, abs(motion[2]) / MAX_EXTRAPOLATED_ANGLE, 1.0
        )
        return Pose.from_array(motion / excess)

    def with_scan(self, time: float, pose: Pose, odometry: Odometry | None) -> TrackingState:
        """The state after one more scan, placed at ``pose`` in the submap's frame."""
        elapsed = time - self.time
        velocity = pose.relative_to(self.pose).as_array() / elapsed if elapsed > 0.0 else self.velocity
        return replace(self, time=time, pose=pose, odometry=odometry, velocity=velocity, scan_time=time)

    def standing_still(self, time: float) -> TrackingState:
        """The state after a scan at which the robot has not moved."""
        return replace(self, velocity=np.zeros(3), scan_time=time)

    def without_match(self, time: float) -> TrackingState:
        """The state after a scan that shows nothing, while odometry is missing or not trusted.

        The next motion is predicted from the scan before, so that extrapolation stays bounded.
        """
        return replace(self, odometry=None, keyframe_odometry=None, scan_time=time)

    def without_keyframe_odometry(self) -> TrackingState:
        """The state with a gap in the odometry since the last keyframe."""
        return replace(self, keyframe_odometry=None)

    def contradicted(self) -> TrackingState:
        """The state after a contradiction between odometry and scan matching."""
        credit = max(self.odometry_credit - CONTRADICTION_COST, 0)
        return replace(self, odometry_credit=credit, keyframe_odometry=None)

    def with_odometry_error(self, error: Floats, motion: Pose) -> TrackingState:
        """The state after an error of odometry since the last keyframe.

        A turn on the spot tells nothing about distances, and a straight drive nothing about angles.

        Args:
            error: The error, [3] standard deviations.
            motion: The matched motion.
        """
        distance = min(math.hypot(motion.x, motion.y) / TELLING_DISTANCE, 1.0)
        angle = min(abs(motion.theta) / TELLING_ANGLE, 1.0)
        clipped = np.clip(error, -MAX_DISAGREEMENT, MAX_DISAGREEMENT)
        gain = BIAS_GAIN * np.array([distance, distance, angle])
        return replace(self, odometry_bias=self.odometry_bias + gain * (clipped - self.odometry_bias))

    def agreed(self) -> TrackingState:
        """The state after a motion on which odometry and scan matching agree."""
        return replace(self, odometry_credit=min(self.odometry_credit + 1, FULL_CREDIT))

    def with_keyframe(self, keyframe: int, noise: MotionNoise, information: Floats) -> TrackingState:
        """The state after the last scan became a keyframe; covariances follow as in a Kalman filter.

        Args:
            keyframe: Index of the keyframe.
            noise: Noise of the motion since the keyframe before.
            information: Information of the keyframe's match in the base_link frame, [3, 3]; zero without a match.
        """
        motion = self.pose.relative_to(self.keyframe_pose)
        motion_covariance = noise.covariance(motion)

        def updated(covariance: Floats) -> Floats:
            predicted = transform_covariance(covariance, motion.inverse) + motion_covariance
            return invert(invert(predicted) + information) + KEYFRAME_COVARIANCE

        return replace(
            self,
            keyframe=keyframe,
            keyframe_pose=self.pose,
            keyframe_odometry=self.odometry,
            covariance=updated(self.covariance),
            next_covariance=updated(self.next_covariance),
        )

    def on_next_submap(self, start: Pose) -> TrackingState:
        """The state tracked on the next submap, whose frame has the pose ``start`` in this submap's frame."""
        return replace(
            self,
            submap=self.submap + 1,
            pose=self.pose.relative_to(start),
            keyframe_pose=self.keyframe_pose.relative_to(start),
            covariance=self.next_covariance,
        )
