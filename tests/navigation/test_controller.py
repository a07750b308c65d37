"""The controllers reach their goals with an ideal differential drive, whose motion is integrated exactly."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from wherry.navigation.controller import (
    HEADING_TOLERANCE,
    POSITION_TOLERANCE,
    STOP_DISTANCE,
    clear_distance,
    drive_line,
    follow_path,
    go_to,
    safe_velocity,
    turn_to,
)
from wherry.robot import Body, Scan, Velocity
from wherry.space.pose import Pose, wrap

BODY = Body(0.2, Pose(-0.15, 0.0, 0.0), 0.1, 0.5, 2.0, 1.0, 6.0)
PERIOD = 0.05  # s, control period


def limit_acceleration(commanded: Velocity, present: Velocity) -> Velocity:
    """The velocity after one period within the limits of acceleration."""
    linear, angular = BODY.max_linear_acceleration * PERIOD, BODY.max_angular_acceleration * PERIOD
    return Velocity(
        float(np.clip(commanded.linear, present.linear - linear, present.linear + linear)),
        float(np.clip(commanded.angular, present.angular - angular, present.angular + angular)),
    )


def drive(pose: Pose, control: Callable[[Pose], Velocity | None], seconds: float = 60.0) -> list[Pose]:
    """The poses until the controller returns None; fails after a time, s."""
    velocity = Velocity()
    poses = [pose]
    for _ in range(round(seconds / PERIOD)):
        commanded = control(pose)
        if commanded is None:
            return poses
        assert abs(commanded.linear) <= BODY.max_linear + 1e-9
        assert abs(commanded.angular) <= BODY.max_angular + 1e-9
        velocity = limit_acceleration(commanded, velocity)
        turned = velocity.angular * PERIOD
        chord = velocity.linear * PERIOD * float(np.sinc(turned / math.tau))  # sinc is 1 at 0
        pose = pose @ Pose(chord * math.cos(turned / 2), chord * math.sin(turned / 2), turned)
        poses.append(pose)
    pytest.fail(f"the robot did not arrive; it stopped at {pose}")


@pytest.mark.parametrize("reverse", [False, True])
def test_a_path_is_followed_closely_to_its_end(reverse: bool) -> None:
    path = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.5, 3.0]])
    poses = drive(Pose(), lambda pose: follow_path(pose, path, BODY, reverse=reverse))
    assert poses[-1].distance_to(Pose(0.5, 3.0)) <= 2 * POSITION_TOLERANCE
    for pose in poses:
        path_error = min(_distance(pose, a, b) for a, b in itertools.pairwise(path))
        assert path_error < 0.15
    halfway = poses[len(poses) // 2]
    driving_direction = wrap(halfway.theta + (math.pi if reverse else 0.0))
    assert abs(wrap(driving_direction - math.pi / 2)) < 0.8


def _distance(pose: Pose, start: np.ndarray, end: np.ndarray) -> float:
    """Distance of a pose from a line segment, m."""
    along = np.clip(np.dot([pose.x, pose.y] - start, end - start) / np.dot(end - start, end - start), 0, 1)
    return math.hypot(*(start + along * (end - start) - [pose.x, pose.y]))


@given(heading=st.floats(-3.2, 3.2), start=st.floats(-3.2, 3.2))
@settings(max_examples=30, deadline=None)
def test_turning_ends_at_the_heading(heading: float, start: float) -> None:
    end = drive(Pose(1.0, 2.0, start), lambda pose: turn_to(pose, heading, BODY))[-1]
    assert abs(wrap(end.theta - heading)) <= HEADING_TOLERANCE
    assert (end.x, end.y) == pytest.approx((1.0, 2.0))


@given(x=st.floats(-1, 1), y=st.floats(-1, 1), theta=st.floats(-3.1, 3.1), reverse=st.booleans())
@example(x=0.5, y=5e-324, theta=0.0, reverse=False)  # half of the required turn rounds to 0
@settings(max_examples=40, deadline=None)
def test_going_to_a_pose_ends_within_a_centimetre_and_a_degree(x: float, y: float, theta: float, reverse: bool) -> None:
    goal = Pose(x, y, theta)
    end = drive(Pose(), lambda pose: go_to(pose, goal, BODY, reverse=reverse))[-1]
    assert end.distance_to(goal) <= POSITION_TOLERANCE
    assert abs(wrap(end.theta - theta)) <= HEADING_TOLERANCE


@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize("offset", [-0.08, 0.0, 0.05])
def test_docking_converges_to_the_line(reverse: bool, offset: float) -> None:
    goal = Pose(1.0, 2.0, 0.8)
    start = goal @ Pose(0.7 if reverse else -0.7, offset, 0.1)
    end = drive(start, lambda pose: drive_line(pose, goal, BODY, reverse=reverse, speed=0.2))[-1].relative_to(goal)
    assert abs(end.x) <= POSITION_TOLERANCE
    assert abs(end.y) <= POSITION_TOLERANCE
    assert abs(end.theta) < math.radians(4.0)


def scan_of(points: list[tuple[float, float]]) -> Scan:
    """A scan with one beam at each point, m, base_link frame."""
    ranges = np.full(3600, np.inf)
    for x, y in points:
        local_x, local_y = x - BODY.lidar.x, y - BODY.lidar.y
        ranges[round(math.degrees(math.atan2(local_y, local_x)) * 10) % 3600] = math.hypot(local_x, local_y)
    return Scan(0.0, ranges, 0.0, math.radians(0.1), 0.05, 12.0)


def test_clear_distance_accounts_for_the_round_footprint() -> None:
    assert clear_distance(scan_of([(1.0, 0.0)]), BODY) == pytest.approx(0.8, abs=1e-3)
    assert clear_distance(scan_of([(1.0, 0.12)]), BODY) == pytest.approx(1.0 - 0.16, abs=2e-3)
    assert clear_distance(scan_of([(1.0, 0.21), (-1.0, 0.0)]), BODY) == math.inf
    assert clear_distance(scan_of([(-1.0, 0.0)]), BODY, reverse=True) == pytest.approx(0.8, abs=1e-3)
    assert clear_distance(scan_of([(0.1, 0.0), (0.0, 0.1)]), BODY) == math.inf, "the load"
    assert clear_distance(scan_of([(0.6, 0.0)]), BODY, ignore=np.array([[0.7, 0.0, 0.15]])) == math.inf


def test_clear_distance_along_an_arc() -> None:
    # A quarter circle of radius 1 m to the left ends at (1, 1). The footprint touches a point there when the chord to
    # it is as long as the footprint's radius. On a straight line or an arc to the right it is not in the way.
    corner = scan_of([(1.0, 1.0)])
    expected = math.pi / 2 - 2 * math.asin(BODY.radius / 2)
    assert clear_distance(corner, BODY, curvature=1.0) == pytest.approx(expected, abs=3e-3)
    assert clear_distance(corner, BODY) == math.inf
    assert clear_distance(corner, BODY, curvature=-1.0) == math.inf
    behind = scan_of([(-1.0, -1.0)])
    assert clear_distance(behind, BODY, reverse=True, curvature=1.0) == pytest.approx(expected, abs=3e-3)


def test_a_safe_velocity_stops_before_an_obstacle() -> None:
    fast = Velocity(0.5, 0.4)
    assert safe_velocity(fast, scan_of([]), BODY) == fast
    slowed = safe_velocity(fast, scan_of([(0.3, 0.0)]), BODY)
    assert 0.0 < slowed.linear < 0.5
    assert slowed.angular / slowed.linear == pytest.approx(0.8)
    near = scan_of([(BODY.radius + STOP_DISTANCE - 0.01, 0.0)])
    assert safe_velocity(fast, near, BODY) == Velocity(0.0, 0.4), "only the angular velocity remains"
    assert safe_velocity(Velocity(0.0, 1.0), near, BODY) == Velocity(0.0, 1.0)
    assert safe_velocity(Velocity(-0.5, 0.0), near, BODY) == Velocity(-0.5, 0.0)
