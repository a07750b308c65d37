"""The lidar's pose on the robot, as a text log states it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from wherry.errors import InputError
from wherry.logs.options import LIDAR_HINT
from wherry.space.pose import IDENTITY, Floats, Pose, relative, wrap_angles

EQUAL_MOUNTS = 1e-3  # m and rad by which equal poses of the lidar on the robot differ
MOUNT_TOLERANCE = 0.02  # m and rad by which rounding of the recorded poses changes it
MOUNT_QUANTILE = 0.9  # share of the scans whose poses agree
MAX_DISTANCE = 10.0  # m, of a lidar from the centre of its robot


def find_mount(
    source: str, pairs: Sequence[tuple[Pose, Pose]], parameter: Pose | None, given: Pose | None
) -> tuple[Pose, str]:
    """The lidar in the base_link frame: as given, else from the poses of the scans if they agree, else as a parameter.

    The poses disagree in logs where only the lidar's poses were corrected afterwards; they are equal where the robot's
    were replaced too.

    Args:
        source: Name of the log.
        pairs: Poses of base_link and of the lidar in the odom frame at the scans.
        parameter: Mount that the log's parameters state; None if there are none.
        given: Mount that the user states; None if there is none.

    Returns:
        The mount, and a note on how it was chosen; empty if there was no choice.

    Raises:
        InputError: Nothing states the mount, or parameters state a place that is not on a robot.
    """
    agreed = agreed_mount(pairs)
    if agreed is not None and math.hypot(agreed.x, agreed.y) > MAX_DISTANCE:
        agreed = None
    if given is None and parameter is not None and math.hypot(parameter.x, parameter.y) > MAX_DISTANCE:
        raise InputError(source, "", f"states by PARAM that the lidar is at {mount_text(parameter)}; {LIDAR_HINT}")
    stated = agreed if agreed is not None and not _is_equal(agreed, IDENTITY) else parameter or agreed
    if given is not None:
        if stated is None or _is_equal(stated, given):
            return given, ""
        return given, f"the log states the lidar at {mount_text(stated)}: the given {mount_text(given)} is used"
    if not pairs and parameter is None:
        reason = "has neither poses of the lidar nor PARAM robot_frontlaser_offset, which state where the lidar sits"
        raise InputError(source, "", f"{reason}; {LIDAR_HINT}")
    if agreed is None and parameter is None:
        reason = "the log does not state where the lidar sits, since the poses of its scans disagree on it"
        return IDENTITY, f"{reason}: the centre of the robot is assumed; {LIDAR_HINT}"
    if pairs and parameter is not None and stated is parameter and not _is_equal(stated, IDENTITY):
        return (
            parameter,
            f"the lidar is at {mount_text(parameter)} by the log's parameters, not by the poses of its scans",
        )
    return stated or IDENTITY, ""


def agreed_mount(pairs: Sequence[tuple[Pose, Pose]]) -> Pose | None:
    """The lidar in the base_link frame by the poses of both, up to their rounding; None if they disagree."""
    if not pairs:
        return None
    robots = np.array([robot.as_array() for robot, _ in pairs])
    mounts = relative(np.array([lidar.as_array() for _, lidar in pairs]), robots)
    if np.abs(_differences(mounts, mounts[0])).max() <= EQUAL_MOUNTS:
        robot, lidar = pairs[0]
        mount = lidar.relative_to(robot)
        return IDENTITY if _is_equal(mount, IDENTITY) else mount
    direction = math.atan2(float(np.sin(mounts[:, 2]).mean()), float(np.cos(mounts[:, 2]).mean()))
    centre = np.array([0.0, 0.0, direction])
    centre += np.median(_differences(mounts, centre), axis=0)
    deviations = np.abs(_differences(mounts, centre)).max(axis=1)
    return Pose.from_array(centre) if np.quantile(deviations, MOUNT_QUANTILE) <= MOUNT_TOLERANCE else None


def _differences(mounts: Floats, centre: Floats) -> Floats:
    """Differences of mounts, [N, 3] m, m, rad, from another, with angles in [−π, π)."""
    differences = mounts - centre
    differences[:, 2] = wrap_angles(differences[:, 2])
    return differences


def _is_equal(mount: Pose, other: Pose) -> bool:
    """Whether two mounts are equal up to rounding."""
    return bool(np.abs(_differences(mount.as_array()[None], other.as_array())).max() <= EQUAL_MOUNTS)


def mount_text(mount: Pose) -> str:
    """A mount as text, in the units of the option."""
    return f"({mount.x:.3f} m, {mount.y:.3f} m, {math.degrees(mount.theta):.1f}°)"
