"""One sentence that says whether a log's scans fit the map and whether the robot knows where it is."""

from __future__ import annotations

import math
from dataclasses import dataclass

from wherry.localization.drive_fit import DriveFit, fits_map
from wherry.localization.localizer import Localization
from wherry.localization.parameters import LOST_PROBABILITY_THRESHOLD
from wherry.space.pose import Pose

GOOD_FIT = 0.85  # fit from which a map agrees with the scans in all parts
EQUAL_MIN_ODDS = 0.25  # odds of an alternative against the estimate from which both are reported as fitting equally
MAX_LISTED = 3  # poses that are listed
SURE_MAP_PROBABILITY = 0.95  # probability of the map being right from which it is not doubted


@dataclass(frozen=True, slots=True)
class AlternativePose:
    """Another pose at the last scan that the run fits.

    Attributes:
        pose: Pose of base_link, x m, y m, θ rad, map frame.
        odds: Odds of this pose against the estimated one.
    """

    pose: tuple[float, float, float]
    odds: float


def alternative_poses(localization: Localization) -> tuple[AlternativePose, ...]:
    """The poses that the run fits about as well as the estimated one, the most probable first."""
    found = []
    for alternative in localization.alternatives:
        odds = math.exp(alternative.log_odds)
        if odds >= EQUAL_MIN_ODDS:
            x, y, theta = alternative.pose.as_array().tolist()
            found.append(AlternativePose((x, y, theta), odds))
    return tuple(found)


def lost_probability(drive: DriveFit, last: Localization) -> float:
    """Probability at the end of a drive that the robot is not at the estimated pose, 0 to 1.

    The probability of the filter supposes that the map is right; on a wrong one no pose is right.
    """
    if not fits_map(drive):
        return 1.0
    return 1.0 - (1.0 - last.lost_probability) * drive.map_probability


def localization_verdict(drive: DriveFit, last: Localization, *, is_global: bool) -> str:
    """The verdict on a localization run.

    Args:
        drive: How well the whole drive fits the map.
        last: Localization at the last scan.
        is_global: Whether the whole map was searched for the start.
    """
    if not fits_map(drive):
        return f"These scans do not fit this map: {_contradiction(drive)}.{_hint(drive, is_global=is_global)}"
    fits = f"The scans fit the map{_reservation(drive)}"
    alternatives = alternative_poses(last)
    if alternatives:
        poses = [last.pose, *(Pose(*alternative.pose) for alternative in alternatives)]
        more = f" and {len(poses) - MAX_LISTED} more" if len(poses) > MAX_LISTED else ""
        listed = ", ".join(map(pose_text, poses[:MAX_LISTED])) + more
        return f"{fits}, but {len(poses)} poses fit equally: {listed}."
    lost = lost_probability(drive, last)
    if last.lost_probability > LOST_PROBABILITY_THRESHOLD:
        return f"{fits}, but the robot is probably lost at the end (probability {lost:.2f})."
    if drive.map_probability < SURE_MAP_PROBABILITY:
        return f"{fits}, {_doubt(drive)} (probability of being lost {lost:.2f})."
    return f"{fits}, and the robot is localized (probability of being lost {lost:.2f})."


def _contradiction(drive: DriveFit) -> str:
    """Why the scans do not fit the map."""
    return drive.fit.mismatch or (
        f"odometry and scans agree with it over {drive.longest:.1f} of {drive.distance:.1f} m at most"
    )


def _hint(drive: DriveFit, *, is_global: bool) -> str:
    """What else it may be if the map is right, as a sentence after the verdict."""
    if not is_global:
        return " If it is the right map, the start pose is wrong: --global searches the whole map."
    if drive.is_short:
        return f" If it is the right map, the drive of {drive.distance:.1f} m is too short to find the pose on it."
    return ""


def _reservation(drive: DriveFit) -> str:
    """The fit, in parentheses, and what a low one means."""
    if drive.fit.value >= GOOD_FIT:
        return f" (fit {drive.fit.value:.2f})"
    return f" only in part (fit {drive.fit.value:.2f}): it may be old, mirrored or at a wrong scale"


def _doubt(drive: DriveFit) -> str:
    """Why it cannot be told whether the map is right."""
    if drive.is_short:
        return f"but the robot drove only {drive.distance:.1f} m: too short to tell whether this is its map"
    return f"and odometry and scans agree with it over {drive.longest:.1f} of {drive.distance:.1f} m at most"


def pose_text(pose: Pose) -> str:
    """A pose as text, m, m, degrees."""
    return f"x {pose.x:.2f} m, y {pose.y:.2f} m, {math.degrees(pose.theta):.0f}°"
