"""The front end's state: pose and covariance on the tracked submap, and the velocity that predicts the next pose."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from wherry.mapping.covariances import invert, transform_covariance
from wherry.mapping.motion_noise import CONSTANT_VELOCITY_NOISE, ODOMETRY_NOISE, MotionNoise
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
        time: Time of the last scan, s.
        pose: base_link at the last scan, in the submap's frame.
        odometry: Odometry at the last scan; None without odometry.
        velocity: Velocity up to the last scan in the base_link frame, [3] m/s, m/s, rad/s.
        keyframe: Index of the last keyframe.
        keyframe_pose: base_link at the last keyframe, in the submap's frame.
        keyframe_odometry: Odometry at the last keyframe; None without odometry.
        covariance: Covariance of ``keyframe_pose`` in the base_link frame, [3, 3] m, m, rad.
        next_covariance: Covariance of the last keyframe's pose in the next submap, in the base_link frame, [3, 3]
            m, m, rad.
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

    @classmethod
    def begin(cls, time: float, odometry: Odometry | None) -> TrackingState:
        """The state at the first scan, which is the first keyframe and the origin of the first submap."""
        return cls(0, time, IDENTITY, odometry, np.zeros(3), 0, IDENTITY, odometry, NO_COVARIANCE, NO_COVARIANCE)

    def predict_motion(self, time: float, odometry: Odometry | None) -> tuple[Pose, MotionNoise]:
        """The motion of base_link since the last scan, with its noise model.

        Without odometry the velocity is taken as constant, but over a gap in the log the motion is bounded.
        """
        if odometry is not None and self.odometry is not None:
            return odometry.pose.relative_to(self.odometry.pose), ODOMETRY_NOISE
        motion = self.velocity * (time - self.time)
        excess = max(
            math.hypot(motion[0], motion[1]) / MAX_EXTRAPOLATED_DISTANCE, abs(motion[2]) / MAX_EXTRAPOLATED_ANGLE, 1.0
        )
        return Pose.from_array(motion / excess), CONSTANT_VELOCITY_NOISE

    def with_scan(self, time: float, pose: Pose, odometry: Odometry | None) -> TrackingState:
        """The state after one more scan, placed at ``pose`` in the submap's frame."""
        elapsed = time - self.time
        velocity = pose.relative_to(self.pose).as_array() / elapsed if elapsed > 0.0 else self.velocity
        return replace(self, time=time, pose=pose, odometry=odometry, velocity=velocity)

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
