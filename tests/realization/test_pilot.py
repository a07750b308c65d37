"""The pilot on a robot without physics: final poses and statuses of drives."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from wherry.floorplan.world_files import find_world
from wherry.realization.load import detects_load, mask_load
from wherry.realization.pilot import DRIVE_TIMEOUT, STANDSTILL_SPEED, DriveStatus, Pilot
from wherry.realization.pose_tracker import PoseTracker
from wherry.robot import Odometry, Scan
from wherry.simulation.model import BODY
from wherry.space.pose import IDENTITY, Pose
from wherry.trace.records import Record, RobotSnapshot
from wherry_testing.kinematic import KinematicRobot, OdometryPoseEstimator
from wherry_testing.perfect_worlds import MovableLidar

SMALL = find_world("small").with_boxes(())  # 4.8 × 3.6 m, the robot at (0.3, 3.3) looking east
START = Pose(0.3, 3.3, 0.0)
WALL_X = 2.4  # m, of the wall between the two rooms; the doorway leads through y = 1.2 to 2.4


def make(odom_from_world: Pose = IDENTITY) -> tuple[Pilot, KinematicRobot, list[Record]]:
    """A pilot whose map frame is the world."""
    robot, records = KinematicRobot(SMALL, odom_from_world), []
    tracker = PoseTracker(OdometryPoseEstimator(odom_from_world), START)
    return Pilot(robot, tracker, records.append), robot, records


def test_the_pose_does_not_depend_on_the_odom_frame() -> None:
    pilot, robot, _ = make(Pose(3.0, -2.0, 1.0))
    pilot.wait_for_scan()
    assert pilot.pose.distance_to(robot.pose) < 1e-9
    assert pilot.follow(np.array([[0.3, 3.3], [1.5, 3.3]])) is DriveStatus.ARRIVED
    assert pilot.pose.distance_to(robot.pose) < 1e-9


def test_scan_callbacks_receive_every_scan_with_its_pose() -> None:
    pilot, _, _ = make()
    received: list[tuple[Scan, Pose]] = []
    pilot.scan_callbacks.append(lambda scan, pose: received.append((scan, pose)))
    first = pilot.wait_for_scan()
    third = pilot.wait_for_scan(2)
    assert [scan.time for scan, _ in received] == pytest.approx([0.1, 0.2, 0.3])
    assert (first, third) == (received[0][0], received[2][0])
    assert all(pose.distance_to(START) < 1e-9 for _, pose in received)


def test_snapshots_are_recorded_five_times_a_second() -> None:
    pilot, _, records = make()
    pilot.wait_for_scan(8)
    assert all(isinstance(record, RobotSnapshot) for record in records)
    assert [record.time for record in records] == pytest.approx([0.1, 0.3, 0.5, 0.7])
    ahead = np.abs(records[0].points[:, 1] - START.y) < 0.01  # in the map frame
    assert records[0].points[ahead, 0].max() == pytest.approx(WALL_X - 0.03, abs=1e-6)


@pytest.mark.parametrize("heading", [math.pi / 2, math.pi, -2.0, 0.0])
def test_turning_does_not_change_the_position(heading: float) -> None:
    pilot, robot, _ = make()
    pilot.turn_to(heading)
    assert abs(math.remainder(robot.pose.theta - heading, math.tau)) < math.radians(1.5)
    assert robot.pose.distance_to(START) < 1e-9


def test_a_path_around_a_corner_is_followed_to_its_end() -> None:
    pilot, robot, records = make()
    path = np.array([[0.3, 3.3], [0.3, 1.8], [3.3, 1.8]])  # through the doorway
    assert pilot.follow(path) is DriveStatus.ARRIVED
    assert math.hypot(robot.pose.x - 3.3, robot.pose.y - 1.8) < 0.02
    assert robot.nearest_wall > BODY.radius
    assert pilot.odometry.velocity.linear == 0.0
    with_path = [record for record in records if isinstance(record, RobotSnapshot) and len(record.path)]
    np.testing.assert_allclose(with_path[0].path, path, atol=1e-6)
    for record in with_path:  # only the remaining path is recorded
        nearest = math.hypot(record.path[0, 0] - record.pose.x, record.path[0, 1] - record.pose.y)
        assert nearest <= np.hypot(*(record.path - [record.pose.x, record.pose.y]).T).min()
    remaining = [float(np.hypot(*np.diff(record.path, axis=0).T).sum()) for record in with_path]
    assert remaining[-1] < 0.2
    assert all(later <= earlier + 1e-6 for earlier, later in itertools.pairwise(remaining))


def test_a_path_through_a_wall_is_blocked_before_the_wall() -> None:
    pilot, robot, _ = make()
    assert pilot.follow(np.array([[0.3, 3.3], [3.3, 3.3]])) is DriveStatus.BLOCKED
    assert BODY.radius < WALL_X - 0.03 - robot.pose.x < BODY.radius + 0.1
    assert abs(pilot.odometry.velocity.linear) < STANDSTILL_SPEED


def test_a_preempted_drive_ends_without_a_stop() -> None:
    pilot, robot, _ = make()
    assert (
        pilot.follow(np.array([[0.3, 3.3], [1.5, 3.3]]), is_preempted=lambda: robot.time >= 1.0)
        is DriveStatus.PREEMPTED
    )
    assert robot.time == pytest.approx(1.0, abs=0.06)
    assert pilot.odometry.velocity.linear > 0.1
    pilot.stop()
    assert pilot.odometry.velocity.linear == 0.0


@pytest.mark.parametrize("reverse", [False, True])
def test_an_approach_ends_at_the_goal(reverse: bool) -> None:
    pilot, robot, _ = make()
    heading = math.pi if reverse else 0.0
    pilot.turn_to(heading)
    assert pilot.approach(Pose(1.5, 3.3, heading), reverse=reverse) is True
    assert math.hypot(robot.pose.x - 1.5, robot.pose.y - 3.3) < 0.015
    assert abs(math.remainder(robot.pose.theta - heading, math.tau)) < 0.05


def test_only_ignored_discs_do_not_block_an_approach() -> None:
    for ignored in (True, False):
        pilot, robot, _ = make()
        robot.boxes.append(np.array([1.5, 3.3]))
        discs = np.array([[1.5, 3.3, 0.2]]) if ignored else np.empty((0, 3))
        arrived = pilot.approach(Pose(1.5, 3.3), reverse=False, ignore=discs, speed=0.3)
        assert arrived is ignored
        assert (robot.pose.x < 1.5 - BODY.radius - BODY.box_radius) is not ignored


def test_going_to_a_pose_returns_whether_the_robot_arrived() -> None:
    pilot, robot, _ = make()
    assert pilot.go_to(Pose(1.2, 3.0, math.pi / 2)) is True
    assert robot.pose.distance_to(Pose(1.2, 3.0)) < 0.02
    assert robot.pose.theta == pytest.approx(math.pi / 2, abs=0.03)
    assert pilot.go_to(Pose(3.3, 3.0)) is False  # behind the wall
    assert robot.nearest_wall > BODY.radius


class JumpingPoseEstimator(OdometryPoseEstimator):
    """A pose estimator that alternates between two positions."""

    def update(self, odometry: Odometry, scan: Scan) -> Pose:
        return super().update(odometry, scan) @ Pose(0.0, 0.05 if self.updates % 2 else -0.05)


def test_a_drive_to_an_unreachable_goal_times_out() -> None:
    pilot, robot, _ = make()
    pilot.use_tracker(PoseTracker(JumpingPoseEstimator(), START))
    start_time = pilot.time
    assert pilot.go_to(Pose(0.9, 3.0)) is False
    assert DRIVE_TIMEOUT <= pilot.time - start_time < DRIVE_TIMEOUT + 5.0
    assert abs(pilot.odometry.velocity.linear) <= STANDSTILL_SPEED
    assert robot.nearest_wall > BODY.radius


def test_a_path_can_be_followed_in_reverse() -> None:
    pilot, robot, _ = make()
    assert pilot.follow(np.array([[0.3, 3.3], [1.5, 3.3]]), reverse=True) is DriveStatus.ARRIVED
    assert math.hypot(robot.pose.x - 1.5, robot.pose.y - 3.3) < 0.03
    assert abs(math.remainder(robot.pose.theta - math.pi, math.tau)) < 0.1


def test_a_new_tracker_starts_at_the_pose_given_to_it() -> None:
    pilot, robot, _ = make()
    pilot.wait_for_scan()
    # The new map's origin is at the robot's position.
    pilot.use_tracker(PoseTracker(OdometryPoseEstimator(START), Pose()))
    assert pilot.pose.distance_to(IDENTITY) < 1e-9
    pilot.go_to(Pose(0.9, 0.0))
    assert robot.pose.distance_to(Pose(1.2, 3.3)) < 0.02


@pytest.mark.parametrize("offset", [0.0, 0.03])
def test_readings_of_a_box_in_the_fork_are_masked(offset: float) -> None:
    lidar = MovableLidar(SMALL)
    without_load, with_load = lidar.scan(START), lidar.scan(START, np.array([[START.x + offset, START.y]]))
    assert not detects_load(without_load, BODY)
    assert mask_load(without_load, BODY) is without_load
    assert detects_load(with_load, BODY)
    masked = mask_load(with_load, BODY)
    is_masked = np.isnan(masked.ranges)
    assert 20 < is_masked.sum() < 120
    np.testing.assert_array_equal(masked.ranges[~is_masked], without_load.ranges[~is_masked])
    assert not detects_load(masked, BODY)
