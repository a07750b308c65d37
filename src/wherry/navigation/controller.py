"""Driving a differential drive along paths and to exact poses: functions from where it is to what to command.

Nothing is remembered between two calls; each is given the pose and answers with the velocity to command now, or None
once it has arrived. Driving in reverse is driving forwards with the robot's back as its front.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from wherry.navigation.path import NO_DISCS
from wherry.robot import Body, Scan, Velocity
from wherry.space.pose import Floats, Pose, wrap

LOOK_AHEAD = 0.3  # m along the path (Coulter 1992)
TURN_FIRST = math.radians(35.0)  # a path that leads off by more than this is begun by turning on the spot
POSITION_TOLERANCE = 0.01  # m
HEADING_TOLERANCE = math.radians(1.0)
BRAKING = 0.5  # share of the acceleration that slowing down is planned with; the rest is for what was not planned
HEADING_GAIN = 2.5  # rad/s per rad
LATERAL_GAIN = 3.0  # rad of heading per m beside the line
CREEP = 0.02  # m/s, the slowest that is still a movement
CREEP_TURN = 0.08  # rad/s
STOP_DISTANCE = 0.04  # m that a safe robot keeps from what it sees in its way
SIDE_DISTANCE = 0.02  # m that it keeps at its sides
AGREEING_BEAMS = 3  # the third shortest gap counts
REACTION_TIME = 0.15  # s from a scan until what is commanded because of it takes hold
STRAIGHT = 1e-3  # 1/m; a way that bends less is straight


def follow_path(pose: Pose, path: Floats, body: Body, *, reverse: bool = False) -> Velocity | None:
    """Follow a path to its end (pure pursuit, Coulter 1992, slowed down where the path bends).

    Args:
        pose: base_link in the map frame.
        path: [N, 2] m, map frame.
        body: The robot's limits.
        reverse: Whether the robot's back leads.

    Returns:
        What to command now; None within `POSITION_TOLERANCE` of the path's end, or once it has been driven past.
    """
    target, rest, direction = _look_ahead(pose, path)
    end = path[-1]
    beyond = (end[0] - pose.x) * math.cos(direction) + (end[1] - pose.y) * math.sin(direction)
    if rest <= POSITION_TOLERANCE or (rest < LOOK_AHEAD and beyond <= POSITION_TOLERANCE):
        return None
    bearing = math.atan2(target[1] - pose.y, target[0] - pose.x)
    error = wrap(bearing - _leading_heading(pose, reverse=reverse))
    if abs(error) > TURN_FIRST:
        return Velocity(0.0, _turning_speed(error, body))
    distance = math.hypot(target[0] - pose.x, target[1] - pose.y)
    curvature = 2.0 * math.sin(error) / max(distance, POSITION_TOLERANCE)
    speed = min(_braking_speed(rest, body), body.max_linear * (1.0 - 0.7 * abs(error) / TURN_FIRST))
    if abs(curvature) * speed > body.max_angular:
        speed = body.max_angular / abs(curvature)
    return Velocity(-speed if reverse else speed, speed * curvature)


def turn_to(pose: Pose, heading: float, body: Body) -> Velocity | None:
    """Turn on the spot to a heading, rad, map frame; None within `HEADING_TOLERANCE`."""
    error = wrap(heading - pose.theta)
    if abs(error) <= HEADING_TOLERANCE:
        return None
    return Velocity(0.0, _turning_speed(error, body))


def drive_line(
    pose: Pose, goal: Pose, body: Body, *, reverse: bool = False, speed: float = math.inf
) -> Velocity | None:
    """Drive along the straight line that leads through a goal at the goal's heading, and stop level with it.

    This is how a robot docks: it comes in along the line, and corrects to it what it stands beside it.

    Args:
        pose: base_link in the map frame.
        goal: Where to stop, and which way to look there.
        body: The robot's limits.
        reverse: Whether the robot's back leads; it looks along the goal's heading all the same.
        speed: m/s, at most.

    Returns:
        What to command now; None once the robot is level with the goal, to within `POSITION_TOLERANCE`.
    """
    seen = pose.relative_to(goal)
    sign = -1.0 if reverse else 1.0
    rest = -sign * seen.x
    if rest <= POSITION_TOLERANCE / 2.0:
        return None
    # Aim back at the line, less steeply the nearer it is.
    aim = -sign * math.atan(LATERAL_GAIN * seen.y)
    error = wrap(aim - seen.theta)
    if abs(error) > TURN_FIRST:
        return Velocity(0.0, _turning_speed(error, body))
    linear = min(_braking_speed(rest, body), speed)
    angular = float(np.clip(HEADING_GAIN * error, -body.max_angular, body.max_angular))
    return Velocity(sign * linear, angular)


def go_to(pose: Pose, goal: Pose, body: Body, *, reverse: bool = False) -> Velocity | None:
    """Go straight to a pose: turn towards it, drive there, turn to its heading.

    Args:
        pose: base_link in the map frame.
        goal: Where to stop, and which way to look there.
        body: The robot's limits.
        reverse: Whether the robot's back leads on the way.

    Returns:
        What to command now; None within `POSITION_TOLERANCE` and `HEADING_TOLERANCE` of the goal.
    """
    distance = pose.distance_to(goal)
    if distance <= POSITION_TOLERANCE:
        return turn_to(pose, goal.theta, body)
    bearing = math.atan2(goal.y - pose.y, goal.x - pose.x)
    error = wrap(bearing - _leading_heading(pose, reverse=reverse))
    # Near the goal a small step aside is a large angle: what matters is whether the line still passes close by.
    if abs(error) > TURN_FIRST or (
        distance * abs(math.sin(error)) > POSITION_TOLERANCE / 2.0 and distance < LOOK_AHEAD
    ):
        return Velocity(0.0, _turning_speed(error, body))
    linear = _braking_speed(distance, body) * max(math.cos(error), 0.0)
    angular = float(np.clip(HEADING_GAIN * error, -body.max_angular, body.max_angular))
    return Velocity(-linear if reverse else linear, angular)


def clear_distance(
    scan: Scan, body: Body, *, reverse: bool = False, curvature: float = 0.0, ignore: Floats = NO_DISCS
) -> float:
    """How far the robot can drive on along an arc before its round body meets what the lidar sees now.

    Args:
        scan: The last one.
        body: The robot's shape.
        reverse: Whether it drives backwards.
        curvature: κ, 1/m, of the arc, positive where it bends to the robot's left as it looks along its way.
        ignore: [K, 3] m, base_link frame: x, y and radius of discs whose readings do not count, such as the box that
            the robot is about to dock on. The load in the fork is always ignored.

    Returns:
        m along the arc; ``inf`` if nothing is seen in the way, at least 0.
    """
    points = body.lidar.transform(scan.points())
    load = np.array([[0.0, 0.0, 1.5 * body.box_radius]])
    for x, y, radius in np.vstack([load, ignore]):
        points = points[np.hypot(points[:, 0] - x, points[:, 1] - y) > radius]
    if reverse:
        points = -points
    points = points[points[:, 0] > 0.0]
    gaps = (
        _gaps_straight(points, body.radius) if abs(curvature) < STRAIGHT else _gaps_arc(points, body.radius, curvature)
    )
    if not len(gaps):
        return math.inf
    # The least of many noisy readings is too short by more than their noise; whatever is near enough to matter is met
    # by several beams.
    agreed = min(AGREEING_BEAMS, len(gaps)) - 1
    return max(float(np.partition(gaps, agreed)[agreed]), 0.0)


def _gaps_straight(points: Floats, radius: float) -> Floats:
    """[M] m that a disc can move along x until it touches those of the points [N, 2] m that are in its way."""
    points = points[np.abs(points[:, 1]) < radius]
    # A circle of the body's radius touches a point that lies aside by y when its middle is so far before it.
    gaps: Floats = points[:, 0] - np.sqrt(radius**2 - points[:, 1] ** 2)
    return gaps


def _gaps_arc(points: Floats, radius: float, curvature: float) -> Floats:
    """[M] m along an arc, likewise: law of cosines in the triangle of the arc's centre, the point and the disc."""
    turn = 1.0 / curvature
    points = points * np.array([1.0, math.copysign(1.0, curvature)])  # bend to the left
    turn = abs(turn)
    away = np.hypot(points[:, 0], points[:, 1] - turn)
    with np.errstate(divide="ignore", invalid="ignore"):
        cosine = (turn**2 + away**2 - radius**2) / (2.0 * turn * away)
    in_way = np.abs(cosine) <= 1.0
    bearing = np.arctan2(points[in_way, 0], turn - points[in_way, 1])  # from the arc's beginning, around its centre
    gaps: Floats = turn * (bearing - np.arccos(cosine[in_way]))
    return gaps


def safe_velocity(velocity: Velocity, scan: Scan, body: Body, *, ignore: Floats = NO_DISCS) -> Velocity:
    """Slow a command down so that the robot can stop `STOP_DISTANCE` before anything that it sees in its way.

    Args:
        velocity: What was to be commanded.
        scan: The last one.
        body: The robot's shape and limits.
        ignore: As in `clear_distance`.

    Returns:
        The same curve, driven slowly enough; where it must stop, only its turning, which is safe for a round body.
    """
    if velocity.linear == 0.0:
        return velocity
    reverse = velocity.linear < 0.0
    curvature = velocity.angular / velocity.linear
    wider = replace(body, radius=body.radius + SIDE_DISTANCE)
    clear = clear_distance(scan, wider, reverse=reverse, curvature=-curvature if reverse else curvature, ignore=ignore)
    gap = clear + SIDE_DISTANCE - STOP_DISTANCE
    if gap <= 0.0:
        return Velocity(0.0, velocity.angular)
    # Between the scan and the moment when the command takes hold, the robot drives on.
    deceleration = BRAKING * body.max_linear_acceleration
    lag = deceleration * REACTION_TIME
    allowed = math.sqrt(lag**2 + 2.0 * deceleration * gap) - lag if math.isfinite(gap) else math.inf
    share = min(1.0, allowed / abs(velocity.linear))
    return Velocity(velocity.linear * share, velocity.angular * share)


def _leading_heading(pose: Pose, *, reverse: bool) -> float:
    """Where the leading end of the robot looks, rad, map frame."""
    return wrap(pose.theta + math.pi) if reverse else pose.theta


def _braking_speed(distance: float, body: Body) -> float:
    """The speed, m/s, from which the robot can stop within a distance, m."""
    return min(body.max_linear, max(math.sqrt(2.0 * BRAKING * body.max_linear_acceleration * distance), CREEP))


def _turning_speed(error: float, body: Body) -> float:
    """The turning speed, rad/s, from which the robot can stop within an angle, rad."""
    speed = math.sqrt(2.0 * BRAKING * body.max_angular_acceleration * abs(error))
    return math.copysign(min(body.max_angular, max(min(speed, HEADING_GAIN * 2.0 * abs(error)), CREEP_TURN)), error)


def _look_ahead(pose: Pose, path: Floats) -> tuple[Floats, float, float]:
    """The point to steer at, [2] m; how much of the path is left, m; the direction of its last stretch, rad."""
    position = np.array([pose.x, pose.y])
    if len(path) == 1:
        path = np.vstack([position, path])
    starts, stretches = path[:-1], np.diff(path, axis=0)
    lengths = np.hypot(*stretches.T)
    shares = np.einsum("ij,ij->i", position - starts, stretches) / np.maximum(lengths, 1e-9) ** 2
    feet = starts + np.clip(shares, 0.0, 1.0)[:, None] * stretches
    distances = np.hypot(*(feet - position).T)
    nearest = len(distances) - 1 - int(np.argmin(distances[::-1]))  # the last one, where a path crosses itself
    done = np.concatenate([[0.0], np.cumsum(lengths)])
    along = done[nearest] + float(np.hypot(*(feet[nearest] - starts[nearest])))
    rest = done[-1] - along + distances[nearest]
    ahead = min(along + LOOK_AHEAD, done[-1])
    target = np.array([np.interp(ahead, done, path[:, 0]), np.interp(ahead, done, path[:, 1])])
    return target, float(rest), math.atan2(stretches[-1, 1], stretches[-1, 0])
