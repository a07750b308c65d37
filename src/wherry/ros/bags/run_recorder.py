"""Recording a run as a bag: the robot's measurements and commands, and the agent's estimates.

Topics and frames have their default names in `wherry.ros.names`. All stamps are times of the robot's clock, and a
transform is written before the scan that needs it.
"""

from __future__ import annotations

import numpy as np

from wherry.robot import Body, Odometry, Robot, Scan, Velocity
from wherry.ros import messages as ros
from wherry.ros.bags.writer import BagWriter
from wherry.ros.encoding import (
    encode_header,
    encode_laser_scan,
    encode_occupancy_grid,
    encode_odometry,
    encode_path,
    encode_pose,
    encode_pose_array,
    encode_transform,
    encode_twist,
)
from wherry.ros.names import load_names
from wherry.ros.nodes.latch_protocol import LatchState, encode_latch_state
from wherry.ros.transforms import StampedTransform
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose
from wherry.trace.records import MapUpdate, Record, RobotSnapshot, StepTaken

MAP_PERIOD = 5.0  # s, between two messages of a growing map, as in gmapping
UNKNOWN_COVARIANCE = np.zeros(36)


class RunRecorder:
    """Records a run: drive the robot that `robot` returns, and use the recorder itself as a sink of trace records.

    Args:
        bag: Bag to write to; the caller closes it.
        laser_height: Height of the lidar above base_link, m.
    """

    def __init__(self, bag: BagWriter, *, laser_height: float = 0.0) -> None:
        names = load_names()
        self._bag = bag
        self._topics, self._frames = names.topics, names.frames
        self._laser_height = laser_height
        self._odometry: Odometry | None = None
        self._next_map = -np.inf

    def robot(self, robot: Robot) -> RecordedRobot:
        """The same robot, recorded."""
        return RecordedRobot(robot, self)

    def __call__(self, record: Record) -> None:
        """Record a trace record for which ROS has a message; ignore others."""
        match record:
            case RobotSnapshot():
                self._write_estimates(record)
            case MapUpdate():
                self._write_growing_map(record)
            case StepTaken():
                plan = encode_path(record.plan, record.time, self._frames.map)
                self._bag.write(self._topics.plan, plan, record.time)
            case _:
                pass

    def write_measurement(self, measurement: Scan | Odometry, lidar: Pose) -> None:
        """Record a measurement.

        Args:
            measurement: What the robot measured.
            lidar: Pose of the lidar in base_link.
        """
        if isinstance(measurement, Scan):
            scan = encode_laser_scan(measurement, self._frames.laser)
            self._bag.write(self._topics.scan, scan, measurement.time)
            return
        if self._odometry is None:
            self._write_mount(measurement.time, lidar)
        self._odometry = measurement
        odom, base = self._frames.odom, self._frames.base_link
        self._write_transform(StampedTransform(odom, base, measurement.time, measurement.pose))
        odometry = encode_odometry(measurement, odom, base, UNKNOWN_COVARIANCE)
        self._bag.write(self._topics.odom, odometry, measurement.time)

    def write_command(self, velocity: Velocity, seconds: float) -> None:
        """Record a velocity command given at a time, s."""
        self._bag.write(self._topics.cmd_vel, encode_twist(velocity), seconds)

    def write_latch_state(self, seconds: float, *, has_load: bool) -> None:
        """Record whether the latch holds a box at a time, s."""
        self._bag.write(self._topics.latch_state, encode_latch_state(LatchState(seconds, has_load, 0.0)), seconds)

    def write_pose_estimate(self, pose: Pose, particles: Floats, seconds: float) -> None:
        """Record an estimate of the robot's pose.

        Args:
            pose: base_link in the map frame.
            particles: [N, 3] x m, y m, θ rad, map frame; may be empty.
            seconds: Time of the estimate, s; odometry of that time must have been recorded before.
        """
        if self._odometry is not None:
            map_from_odom = pose @ self._odometry.pose.inverse
            self._write_transform(StampedTransform(self._frames.map, self._frames.odom, seconds, map_from_odom))
        if len(particles):
            header = encode_header(seconds, self._frames.map)
            estimate = ros.PoseWithCovariance(encode_pose(pose), _covariance(particles, pose))
            self._bag.write(self._topics.amcl_pose, ros.PoseWithCovarianceStamped(header, estimate), seconds)
            poses = encode_pose_array(particles, seconds, self._frames.map)
            self._bag.write(self._topics.particlecloud, poses, seconds)

    def write_map(self, grid: OccupancyGrid, seconds: float) -> None:
        """Record a map at a time, s."""
        self._bag.write(self._topics.map, encode_occupancy_grid(grid, seconds, self._frames.map), seconds)

    def _write_growing_map(self, record: MapUpdate) -> None:
        """Record a map that is complete, or the first one after each `MAP_PERIOD`."""
        if record.time >= self._next_map or record.explored_fraction >= 1.0:
            self._next_map = record.time + MAP_PERIOD
            self.write_map(record.grid, record.time)

    def _write_estimates(self, record: RobotSnapshot) -> None:
        self.write_pose_estimate(record.pose, record.particles.astype(np.float64), record.time)
        path = encode_path(record.path, record.time, self._frames.map)
        self._bag.write(self._topics.predicted_path, path, record.time)

    def _write_mount(self, seconds: float, lidar: Pose) -> None:
        mount = StampedTransform(self._frames.base_link, self._frames.laser, seconds, lidar)
        message = ros.TFMessage((encode_transform(mount, self._laser_height),))
        self._bag.write(self._topics.tf_static, message, seconds)

    def _write_transform(self, transform: StampedTransform) -> None:
        self._bag.write(self._topics.tf, ros.TFMessage((encode_transform(transform),)), transform.time)


def _covariance(particles: Floats, mean: Pose) -> Floats:
    """Covariance [36] of particles [N, 3] about a pose, over x, y, z and the rotations about x, y, z."""
    deviations = particles - mean.as_array()
    deviations[:, 2] = np.arctan2(np.sin(deviations[:, 2]), np.cos(deviations[:, 2]))
    covariance = np.zeros((6, 6))
    covariance[np.ix_((0, 1, 5), (0, 1, 5))] = deviations.T @ deviations / len(deviations)
    return covariance.ravel()


class RecordedRobot:
    """A robot whose measurements, commands and latch are recorded.

    Args:
        robot: The robot that drives.
        recorder: Recorder to write with.
    """

    def __init__(self, robot: Robot, recorder: RunRecorder) -> None:
        self._robot = robot
        self._recorder = recorder
        self._time = 0.0  # s, of the last measurement

    @property
    def body(self) -> Body:
        """The robot's shape and limits."""
        return self._robot.body

    def receive(self) -> Scan | Odometry:
        """As `Robot.receive`."""
        measurement = self._robot.receive()
        self._time = measurement.time
        self._recorder.write_measurement(measurement, self.body.lidar)
        return measurement

    def command(self, velocity: Velocity) -> None:
        """As `Robot.command`."""
        self._robot.command(velocity)
        self._recorder.write_command(velocity, self._time)

    def close_latch(self) -> bool:
        """As `Robot.close_latch`."""
        has_load = self._robot.close_latch()
        self._recorder.write_latch_state(self._time, has_load=has_load)
        return has_load

    def open_latch(self) -> bool:
        """As `Robot.open_latch`."""
        is_free = self._robot.open_latch()
        self._recorder.write_latch_state(self._time, has_load=not is_free)
        return is_free
