"""Motion controllers of a differential drive: path following, docking along a line, turning, and collision avoidance.

Each controller is a stateless function that returns the velocity to command at a pose, or None at the goal.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from wherry.robot import Body, Scan, Velocity
from wherry.space.occupancy import NO_DISCS
from wherry.space.pose import Floats, Pose, wrap

LOOKAHEAD_DISTANCE = 0.3  # m along the path (Coulter 1992)
ROTATE_IN_PLACE_ANGLE = math.radians(35.0)  # heading error above which the robot turns on the spot
POSITION_TOLERANCE = 0.01  # m from the goal
HEADING_TOLERANCE = math.radians(1.0)  # from the goal's heading
DECELERATION_FRACTION = 0.5  # planned deceleration ÷ largest possible one; leaves a reserve for braking harder
HEADING_GAIN = 2.5  # rad/s of angular velocity per rad of heading error
LATERAL_GAIN = 3.0  # rad of heading per m of lateral error
MIN_LINEAR_SPEED = 0.02  # m/s, lower limit of the speed near a goal
MIN_ANGULAR_SPEED = 0.08  # rad/s, lower limit of the angular speed near a heading
BEND_SLOWDOWN = 0.7  # reduction of the speed at a heading error of ROTATE_IN_PLACE_ANGLE ÷ largest speed
STOP_DISTANCE = 0.04  # m between the robot's front and an obstacle at which it stops
SIDE_CLEARANCE = 0.02  # m that must remain between the robot's side and an obstacle that it passes
MIN_OBSTACLE_BEAMS = 3  # beams that must hit an obstacle; a single noisy one does not stop the robot
REACTION_TIME = 0.15  # s of latency from a scan until a command computed from it takes effect
MIN_CURVATURE = 1e-3  # 1/m, below which an arc is treated as a straight line


def follow_path(pose: Pose, path: Floats, body: Body, *, reverse: bool = False) -> Velocity | None:
    """Follow a path to its end by pure pursuit (Coulter 1992), slowing down in bends.

    Args:
        pose: base_link in the map frame.
        path: [N, 2] waypoints, m, map frame.
        body: The robot's limits.
        reverse: Whether to drive backwards.

    Returns:
        The velocity to command now; None within `POSITION_TOLERANCE` of the path's end, or once beyond it.
    """
    target, remaining, direction = _lookahead_point(pose, path)
    end = path[-1]
    along = (end[0] - pose.x) * math.cos(direction) + (end[1] - pose.y) * math.sin(direction)
    if remaining <= POSITION_TOLERANCE or (remaining < LOOKAHEAD_DISTANCE and along <= POSITION_TOLERANCE):
        return None
    bearing = math.atan2(target[1] - pose.y, target[0] - pose.x)
    error = wrap(bearing - _driving_direction(pose, reverse=reverse))
    if abs(error) > ROTATE_IN_PLACE_ANGLE:
        return Velocity(0.0, _turning_speed(error, body))
    distance = math.hypot(target[0] - pose.x, target[1] - pose.y)
    curvature = 2.0 * math.sin(error) / max(distance, POSITION_TOLERANCE)
    bend_speed = body.max_linear * (1.0 - BEND_SLOWDOWN * abs(error) / ROTATE_IN_PLACE_ANGLE)
    speed = min(_braking_speed(remaining, body), bend_speed)
    if abs(curvature) * speed > body.max_angular:
        speed = body.max_angular / abs(curvature)
    return Velocity(-speed if reverse else speed, speed * curvature)


def turn_to(pose: Pose, heading: float, body: Body) -> Velocity | None:
    """Turn on the spot to a heading.

    Args:
        pose: base_link in the map frame.
        heading: Heading to turn to, rad, map frame.
        body: The robot's limits.

    Returns:
        The velocity to command now; None within `HEADING_TOLERANCE` of the heading.
    """
    error = wrap(heading - pose.theta)
    if abs(error) <= HEADING_TOLERANCE:
        return None
    return Velocity(0.0, _turning_speed(error, body))


def drive_line(
    pose: Pose, goal: Pose, body: Body, *, reverse: bool = False, speed: float = math.inf
) -> Velocity | None:
    """Dock: drive along the line through a goal in the direction of its heading, and stop level with it.

    Args:
        pose: base_link in the map frame.
        goal: Where to stop, and the heading there, map frame.
        body: The robot's limits.
        reverse: Whether to drive backwards; the robot's heading at the goal is the goal's in either case.
        speed: Largest speed, m/s.

    Returns:
        The velocity to command now; None once the robot is level with the goal or beyond it, or less than half of
        `POSITION_TOLERANCE` before it.
    """
    offset = pose.relative_to(goal)
    sign = -1.0 if reverse else 1.0
    remaining = -sign * offset.x
    if remaining <= POSITION_TOLERANCE / 2.0:
        return None
    # The desired heading, relative to the line, points back to the line in proportion to small lateral errors.
    desired = -sign * math.atan(LATERAL_GAIN * offset.y)
    error = wrap(desired - offset.theta)
    if abs(error) > ROTATE_IN_PLACE_ANGLE:
        return Velocity(0.0, _turning_speed(error, body))
    linear = min(_braking_speed(remaining, body), speed)
    angular = float(np.clip(HEADING_GAIN * error, -body.max_angular, body.max_angular))
    return Velocity(sign * linear, angular)


def go_to(pose: Pose, goal: Pose, body: Body, *, reverse: bool = False) -> Velocity | None:
    """Drive straight to a pose: turn towards it, drive there, turn to its heading.

    Args:
        pose: base_link in the map frame.
        goal: Where to stop, and the heading there, map frame.
        body: The robot's limits.
        reverse: Whether to drive backwards on the way.

    Returns:
        The velocity to command now; None within `POSITION_TOLERANCE` and `HEADING_TOLERANCE` of the goal.
    """
    distance = pose.distance_to(goal)
    if distance <= POSITION_TOLERANCE:
        return turn_to(pose, goal.theta, body)
    bearing = math.atan2(goal.y - pose.y, goal.x - pose.x)
    error = wrap(bearing - _driving_direction(pose, reverse=reverse))
    # Near the goal a small lateral error is a large heading error, so the lateral error decides whether to turn.
    lateral_error = distance * abs(math.sin(error))
    if abs(error) > ROTATE_IN_PLACE_ANGLE or (
        lateral_error > POSITION_TOLERANCE / 2.0 and distance < LOOKAHEAD_DISTANCE
    ):
        return Velocity(0.0, _turning_speed(error, body))
    linear = _braking_speed(distance, body) * max(math.cos(error), 0.0)
    angular = float(np.clip(HEADING_GAIN * error, -body.max_angular, body.max_angular))
    return Velocity(-linear if reverse else linear, angular)


def clear_distance(
    scan: Scan, body: Body, *, reverse: bool = False, curvature: float = 0.0, ignore: Floats = NO_DISCS
) -> float:
    """The distance that the robot's round footprint can move along an arc before it touches an obstacle in the scan.

    Args:
        scan: The last scan.
        body: The robot's shape.
        reverse: Whether to drive backwards.
        curvature: Curvature κ of the arc, 1/m, positive for a bend to the left as seen in the direction of travel.
        ignore: [K, 3] x, y, radius, m, base_link frame, of discs in which readings are ignored, such as the box to
            dock on. Readings of a box in the fork are always ignored.

    Returns:
        Distance along the arc, m, at least 0; ``inf`` if no obstacle is in the way.
    """
    points = body.lidar.transform(scan.points())
    load = np.array([[0.0, 0.0, body.load_radius]])
    for x, y, radius in np.vstack([load, ignore]):
        points = points[np.hypot(points[:, 0] - x, points[:, 1] - y) > radius]
    if reverse:
        points = -points
    points = points[points[:, 0] > 0.0]
    if abs(curvature) < MIN_CURVATURE:
        distances = _distances_straight(points, body.radius)
    else:
        distances = _distances_on_arc(points, body.radius, curvature)
    if not len(distances):
        return math.inf
    rank = min(MIN_OBSTACLE_BEAMS, len(distances)) - 1
    return max(float(np.partition(distances, rank)[rank]), 0.0)


def _distances_straight(points: Floats, radius: float) -> Floats:
    """[M] distances, m, that a disc can move along x until it touches each of the M points [N, 2], m, in its way."""
    points = points[np.abs(points[:, 1]) < radius]
    # The disc touches a point at lateral offset y when its centre is √(r² − y²) before the point.
    distances: Floats = points[:, 0] - np.sqrt(radius**2 - points[:, 1] ** 2)
    return distances


def _distances_on_arc(points: Floats, radius: float, curvature: float) -> Floats:
    """As `_distances_straight`, along an arc, by the law of cosines in the triangle of arc centre, point and disc."""
    points = points * np.array([1.0, math.copysign(1.0, curvature)])  # mirrored so that the arc bends to the left
    turn_radius = abs(1.0 / curvature)
    from_centre = np.hypot(points[:, 0], points[:, 1] - turn_radius)
    with np.errstate(divide="ignore", invalid="ignore"):
        cosine = (turn_radius**2 + from_centre**2 - radius**2) / (2.0 * turn_radius * from_centre)
    in_way = np.abs(cosine) <= 1.0
    bearing = np.arctan2(points[in_way, 0], turn_radius - points[in_way, 1])  # around the arc's centre, from its start
    distances: Floats = turn_radius * (bearing - np.arccos(cosine[in_way]))
    return distances


def safe_velocity(velocity: Velocity, scan: Scan, body: Body, *, ignore: Floats = NO_DISCS) -> Velocity:
    """Slow a command down so that the robot can stop `STOP_DISTANCE` before every obstacle in the scan.

    Args:
        velocity: The command.
        scan: The last scan.
        body: The robot's shape and limits.
        ignore: [K, 3] x, y, radius, m, base_link frame, of discs in which readings are ignored.

    Returns:
        The command, scaled down so that it stays on the same arc. Where the robot must stop, its angular velocity is
        kept, since a round footprint can turn safely.
    """
    if velocity.linear == 0.0:
        return velocity
    reverse = velocity.linear < 0.0
    curvature = velocity.angular / velocity.linear
    inflated = replace(body, radius=body.radius + SIDE_CLEARANCE)
    clear = clear_distance(
        scan, inflated, reverse=reverse, curvature=-curvature if reverse else curvature, ignore=ignore
    )
    gap = clear + SIDE_CLEARANCE - STOP_DISTANCE
    if gap <= 0.0:
        return Velocity(0.0, velocity.angular)
    # The largest safe v solves v · REACTION_TIME + v² / (2 · deceleration) = gap.
    deceleration = DECELERATION_FRACTION * body.max_linear_acceleration
    reaction_speed = deceleration * REACTION_TIME
    allowed = math.inf
    if math.isfinite(gap):
        allowed = math.sqrt(reaction_speed**2 + 2.0 * deceleration * gap) - reaction_speed
    scale = min(1.0, allowed / abs(velocity.linear))
    return Velocity(velocity.linear * scale, velocity.angular * scale)


def _driving_direction(pose: Pose, *, reverse: bool) -> float:
    """Direction in which the robot drives, rad, map frame."""
    return wrap(pose.theta + math.pi) if reverse else pose.theta


def _braking_speed(distance: float, body: Body) -> float:
    """Speed, m/s, from which the robot can stop within a distance, m."""
    deceleration = DECELERATION_FRACTION * body.max_linear_acceleration
    return min(body.max_linear, max(math.sqrt(2.0 * deceleration * distance), MIN_LINEAR_SPEED))


def _turning_speed(error: float, body: Body) -> float:
    """Angular velocity, rad/s, that reduces a heading error, rad, and from which the robot can stop within it."""
    deceleration = DECELERATION_FRACTION * body.max_angular_acceleration
    speed = min(math.sqrt(2.0 * deceleration * abs(error)), HEADING_GAIN * 2.0 * abs(error))
    return math.copysign(min(body.max_angular, max(speed, MIN_ANGULAR_SPEED)), error)


def _lookahead_point(pose: Pose, path: Floats) -> tuple[Floats, float, float]:
    """[2] lookahead point, m, map frame; remaining length of the path, m; direction of its last segment, rad."""
    position = np.array([pose.x, pose.y])
    if len(path) == 1:
        path = np.vstack([position, path])
    starts, segments = path[:-1], np.diff(path, axis=0)
    lengths = np.hypot(*segments.T)
    fractions = np.einsum("ij,ij->i", position - starts, segments) / np.maximum(lengths, 1e-9) ** 2
    projections = starts + np.clip(fractions, 0.0, 1.0)[:, None] * segments
    distances = np.hypot(*(projections - position).T)
    nearest = len(distances) - 1 - int(np.argmin(distances[::-1]))  # the last one where the path crosses itself
    arc_length = np.concatenate([[0.0], np.cumsum(lengths)])
    along = arc_length[nearest] + float(np.hypot(*(projections[nearest] - starts[nearest])))
    remaining = arc_length[-1] - along + distances[nearest]
    ahead = min(along + LOOKAHEAD_DISTANCE, arc_length[-1])
    target = np.array([np.interp(ahead, arc_length, path[:, 0]), np.interp(ahead, arc_length, path[:, 1])])
    return target, float(remaining), math.atan2(segments[-1, 1], segments[-1, 0])
